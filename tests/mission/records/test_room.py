import shutil

import pytest

from mission.records.room import PICTURES_NEED_BYTES, RECORDING_NEEDS_BYTES, Room, RoomWatch


@pytest.fixture
def disk(monkeypatch):
    """A disk whose free bytes are the last of a list; an empty list: it does not say."""
    left = [1 << 40]

    def usage(_folder):
        if not left:
            raise OSError("Input/output error")
        return shutil._ntuple_diskusage(1 << 41, 0, left[-1])

    monkeypatch.setattr("mission.records.room.shutil.disk_usage", usage)
    return left


def test_the_live_picture_goes_first_then_the_recording_and_neither_comes_back(tmp_path, disk):
    watch = RoomWatch(tmp_path)
    rooms = []
    for free in (PICTURES_NEED_BYTES, PICTURES_NEED_BYTES - 1, RECORDING_NEEDS_BYTES, 0, 1 << 40):
        disk.append(free)
        watch.look(100.0)
        rooms.append(watch.room)
    assert rooms == [Room.EVERYTHING, Room.RECORDING, Room.RECORDING, Room.PHOTOS, Room.PHOTOS]
    pictures, recording = watch.words
    assert pictures.startswith("the live picture is not in the recording from mission second 100")
    assert pictures.endswith("511 MiB were left on the disk")
    assert recording.startswith("the recording ends from mission second 100 on: 0 MiB")


def test_a_disk_that_does_not_say_is_taken_to_have_room(tmp_path, disk):
    disk.clear()
    watch = RoomWatch(tmp_path)
    watch.look(1.0)
    assert watch.room is Room.EVERYTHING
    assert watch.words == ()
