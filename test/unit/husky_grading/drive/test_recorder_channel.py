"""Channel to the recorder: marking knows what it has told, and that it has ended, in whatever moment."""

import os
from multiprocessing.connection import Connection
from types import SimpleNamespace

import pytest

from husky_grading.drive.recorder_channel import (
    Assignment,
    GoOn,
    Joined,
    Now,
    Over,
    Ready,
    RecorderChannel,
)
from husky_grading.recording import Recording
from husky_highlevel_controller.datatypes import Pose2D

TASK = Assignment(Recording(Pose2D(), (20.0, 5.0), 60.0), "/truth", 3, ("/husky_simulator",))


class Network:
    """Starts no program, and keeps the recorder's end of the channel."""

    def start(self, name, command, handed):
        (theirs,) = handed
        self.recorder = Connection(os.dup(theirs.fileno()))
        return SimpleNamespace(running=True)


@pytest.fixture
def network():
    return Network()


@pytest.fixture
def channel(network):
    return RecorderChannel(network, TASK)


def test_the_task_comes_first_then_what_marking_says(network, channel):
    channel.send(GoOn())
    assert network.recorder.recv().truth_socket == "/truth"
    assert network.recorder.recv() == GoOn()


def test_the_state_is_that_of_all_messages_so_far(network, channel):
    assert not channel.update().ready
    for message in (Ready(), Now(0.2, False), Joined(), Now(0.4, True)):
        network.recorder.send(message)
    channel.update()
    assert (channel.ready, channel.joined, channel.over) == (True, True, False)
    assert (channel.now, channel.subscribed) == (0.4, True)
    network.recorder.send(Over())
    network.recorder.send(TASK.recording)
    assert channel.update().over
    assert channel.recording.pillar == (20.0, 5.0)


def test_a_recorder_that_has_ended_tells_what_it_still_told_and_is_asked_for_nothing(network, channel):
    network.recorder.send(Now(3.0, True))
    network.recorder.close()
    channel.update()
    assert (channel.now, channel.is_open, channel.recording) == (3.0, False, None)
    channel.send(GoOn())


def test_a_recorder_that_ends_within_a_message_has_told_none(network, channel):
    os.write(network.recorder.fileno(), b"\0\0\1\0half")
    network.recorder.close()
    assert not channel.update().is_open
    assert channel.recording is None
