import logging

from mission.cli.serve_command import _see_missions_dir


def test_a_folder_that_cannot_be_written_is_told_when_the_daemon_starts(tmp_path, caplog):
    (tmp_path / "file").write_text("")
    with caplog.at_level(logging.ERROR):
        _see_missions_dir(tmp_path / "new")
        assert caplog.messages == []
        _see_missions_dir(tmp_path / "file" / "missions")
    (told,) = caplog.messages
    assert "missions_dir" in told
    assert "every start will be refused" in told
    assert list((tmp_path / "new").iterdir()) == []
