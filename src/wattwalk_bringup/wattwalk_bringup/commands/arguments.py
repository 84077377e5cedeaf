"""Arguments of the command."""

from argparse import ArgumentParser, BooleanOptionalAction, Namespace

from wattwalk_core.command import Arguments, entry_point, own_arguments

from wattwalk_bringup.settings import arguments

_LIVE = """\
Each argument replaces an entry of the file. Ctrl-C ends all nodes, the policy runner first,
and so does the end of any of them. Exit code: 0, 1 if a node failed, 2 for bad input.

example, the simulated robot, a minute of it recorded:
  ros2 run wattwalk_bringup live --record bags/walk_1 --duration 60
example, a robot on can0, which walks once `/policy_runner/start` is called:
  ros2 run wattwalk_bringup live --config robot --dbc robot.dbc --mapping robot.yaml
example, settings of your own:
  ros2 run wattwalk_bringup live --config lab.yaml --velocity=0.4,0,0
"""


@entry_point(
    'wattwalk_bringup.commands.live:run',
    'The simulated robot or the DAQ of a real one, policy runner, estimator and recorder: '
    'started together, shown in one terminal, ended as one.',
    _LIVE,
)
def live(parser: ArgumentParser, args: Arguments) -> Namespace:
    parser.add_argument(
        '--config', default='sim', metavar='FILE', help='YAML file, or one of sim (default), robot'
    )
    for argument in arguments():
        option = f'--{argument.name.replace("_", "-")}'
        if argument.is_flag:
            parser.add_argument(option, action=BooleanOptionalAction, help=argument.description)
        else:
            parser.add_argument(
                option,
                metavar='|'.join(argument.choices) or argument.name.upper(),
                help=argument.description,
            )
    own = own_arguments(args)
    for argument in arguments():
        option = argument.name.replace('_', '-')
        if argument.is_flag and {f'--{option}', f'--no-{option}'} <= {*own}:
            parser.error(f'argument --no-{option}: not allowed with argument --{option}')
    return parser.parse_args(own)
