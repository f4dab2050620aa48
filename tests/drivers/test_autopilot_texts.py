from drivers.autopilot_texts import StatusTexts


def test_a_sentence_in_parts_is_one_sentence() -> None:
    texts = StatusTexts()
    texts.take(1.0, 6, "Armed by external command\t", (0, 0))
    texts.take(2.0, 2, "Switching to mode 'Offboard' is currently not poss", (7, 0))
    texts.take(2.0, 2, "ible\t", (7, 1))
    assert [text.text for text in texts.newest] == [
        "Armed by external command",
        "Switching to mode 'Offboard' is currently not possible",
    ]


def test_a_part_whose_beginning_was_lost_stands_alone() -> None:
    texts = StatusTexts()
    texts.take(1.0, 6, "Landing detected", (0, 0))
    texts.take(2.0, 2, "the end of another sentence", (8, 1))
    assert [text.text for text in texts.newest] == [
        "Landing detected",
        "the end of another sentence",
    ]


def test_the_newest_fifty_are_kept() -> None:
    texts = StatusTexts()
    for number in range(60):
        texts.take(float(number), 6, str(number), (0, 0))
    assert [text.text for text in texts.newest] == [str(number) for number in range(10, 60)]
