from dataclasses import replace

import numpy as np
from policy_runner.pacing import HURRY
from policy_runner.trot import TROTS, ScriptedTrot
from policy_training.config import TrainingConfig
from policy_training.environment import WalkingEnvironment
from sim_bridge.robot import DEFAULT_POSE

ROBOTS = 32
SECONDS = 8.0


def falls(hurry):
    """Falls of the scripted trot at 1.6 Hz, pushed by up to 1.2 m/s every 2 s."""
    config = TrainingConfig().with_values(
        {
            'physics.environments': ROBOTS,
            'physics.threads': 1,
            'random.push': 1.2,
            'random.push_period': 2.0,
            'random.resting': 0.0,
            'commands.ramp_from': 1.0,
        }
    )
    environment = WalkingEnvironment(config)
    environment.age[:] = 0
    gait = replace(TROTS['trot'], ramp=0.3, frequency=1.6, hurry=hurry)
    trots = [ScriptedTrot(gait) for _ in range(ROBOTS)]
    fallen = 0
    for step in range(round(SECONDS / 0.02)):
        motion, shown = environment.motion, environment.shown.values
        targets = [
            trot.step(
                0.02 * (step + 1),
                shown[robot],
                motion.position[robot],
                motion.gravity[robot],
                motion.rate[robot],
                motion.velocity[robot],
            )
            for robot, trot in enumerate(trots)
        ]
        outcome = environment.step((np.stack(targets) - DEFAULT_POSE) / config.action_scale)
        for robot in np.flatnonzero(outcome.done):
            trots[robot].reset()
        fallen += int((outcome.done & ~outcome.timed_out).sum())
    return fallen


def test_a_trot_that_hurries_withstands_pushes_that_throw_over_one_that_does_not():
    steady, hurried = falls(()), falls(HURRY)
    assert steady >= 8
    assert hurried <= steady // 4
