"""`ros2 run policy_training export`: a policy as TorchScript, with its contract beside it."""

import argparse

from policy_runner.policies.by_name import learned_folder
from policy_runner.policies.torchscript import write_torchscript

from policy_training.learning.run_folder import policy_source


def run(options: argparse.Namespace) -> None:
    contract = write_torchscript(learned_folder(policy_source(options.policy)), options.output)
    print(f'wrote {options.output} and {contract}')
    print(f'ros2 run policy_runner run --policy {options.output} --trust-code')
