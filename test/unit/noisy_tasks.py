"""Tasks that the tests of the pool and of the cluster share."""

import os
import signal

import numpy as np


def noise(number):
    return np.random.default_rng(number).normal(size=3).tolist()


def noise_after_a_death(folder, number):
    """The first worker that is to do number 5 is killed, like by the kernel when memory ends."""
    if number == 5 and not (folder / "died").exists():
        (folder / "died").write_text("")
        os.kill(os.getpid(), signal.SIGKILL)
    return noise(number)
