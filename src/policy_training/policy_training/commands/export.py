"""`ros2 run policy_training export`: a policy as TorchScript, with its contract beside it."""

from collections.abc import Sequence
from pathlib import Path

from wattwalk_core.command import command, command_parser
from wattwalk_core.console import check_suffix

_EPILOG = """\
POLICY is a shipped one (baseline, economy, pmp, …), a policy folder or a training run.
FILE.yaml beside FILE.pt is its contract: what the observation holds, in which scale and order,
joints, default pose, action scale, gains and rate.

examples:
  ros2 run policy_training export pmp -o pmp.pt
  ros2 run policy_runner run --policy pmp.pt --trust-code
"""


@command
def main(args: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = command_parser(
        'policy_training export',
        'Write a learned policy as TorchScript, from observations [N, size] to actions [N, 12].',
        _EPILOG,
    )
    parser.add_argument('policy', metavar='POLICY', help='name, folder or run')
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='FILE.pt')
    options = parser.parse_args(args)
    check_suffix(options.output, '--output', ('.pt',))

    from policy_runner.policies.by_name import learned_folder
    from policy_runner.policies.torchscript import write_torchscript

    from policy_training.learning.run_folder import policy_source

    folder = learned_folder(policy_source(options.policy))
    contract = write_torchscript(folder, options.output)
    print(f'wrote {options.output} and {contract}')
    print(f'ros2 run policy_runner run --policy {options.output} --trust-code')
    return 0
