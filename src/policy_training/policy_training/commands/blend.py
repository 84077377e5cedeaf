"""`ros2 run policy_training blend`: an economical policy with a sturdy one to fall back on."""

import argparse

from policy_runner.policies.by_name import learned_folder
from policy_runner.policies.folder import Fallback

from policy_training.learning.blend import blend_policies
from policy_training.learning.run_folder import policy_source


def run(options: argparse.Namespace) -> int:
    blend_policies(
        learned_folder(policy_source(options.policy)),
        learned_folder(policy_source(options.fallback)),
        Fallback(onset=options.onset, full=options.full),
        options.output,
        options.name or options.output.resolve().name,
    )
    print(f'wrote {options.output}')
    print(f'next: ros2 run policy_training evaluate --policies {options.policy} {options.output}')
    return 0
