"""`ros2 run policy_training blend`: an economical policy with a sturdy one to fall back on."""

from collections.abc import Sequence
from pathlib import Path

from wattwalk_core.command import command, command_parser

_EPILOG = """\
POLICY and FALLBACK are shipped ones (baseline, economy, …), policy folders or training runs. The
fallback acts out of balance, under commands that mix axes and when the robot is to stand.

examples:
  ros2 run policy_training blend runs/calm runs/sturdy -o runs/blend
  ros2 run policy_training evaluate --policies baseline runs/blend
"""


@command
def main(args: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = command_parser(
        'policy_training blend',
        'Join two learned policies into one that is economical in balance and sturdy out of it.',
        _EPILOG,
    )
    add = parser.add_argument
    add('policy', metavar='POLICY', help='acts in balance; the gait clock is its')
    add('fallback', metavar='FALLBACK', help='acts elsewhere')
    add('-o', '--output', type=Path, required=True, metavar='FOLDER', help='of the new policy')
    add('--name', help='of the new policy, that of FOLDER if absent')
    add('--onset', type=float, default=0.2, help='capture-point error, m/s, of its first share')
    add('--full', type=float, default=0.5, help='capture-point error, m/s, where it acts alone')
    options = parser.parse_args(args)

    from policy_runner.policies.by_name import learned_folder
    from policy_runner.policies.folder import Fallback

    from policy_training.learning.blend import blend_policies
    from policy_training.learning.run_folder import policy_source

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
