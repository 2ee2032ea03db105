"""Simulations of the tests here."""

import pytest
from stage import BLIND, GROUND

from husky_highlevel_controller.datatypes import Pose2D, World
from husky_highlevel_controller.simulator.simulation import Simulation
from husky_highlevel_controller.simulator.simulator_config import simulator_config


@pytest.fixture
def simulate():
    """Makes simulations of a world, or of bodies on the ground, and closes them."""
    made = []

    def make(*bodies, robot=BLIND, start=Pose2D(), seed=0, config=None, ground=GROUND, **more):  # noqa: B008
        world = bodies[0] if bodies and isinstance(bodies[0], World) else World("w", (ground, *bodies))
        made.append(Simulation(world, robot, config or simulator_config(), start, seed, **more))
        return made[-1]

    yield make
    for simulation in made:
        simulation.close()
