"""Arguments of the commands."""

from argparse import ArgumentParser, Namespace
from pathlib import Path

from power_recordings.commands.arguments import add_doubts
from wattwalk_core.command import Arguments, entry_point, watt_hours
from wattwalk_core.console import ending
from wattwalk_core.engine.options import add_workplace
from wattwalk_core.errors import InputError


def add_effects_path(parser: ArgumentParser) -> None:
    """Add --effects-path: files of the user's own effects."""
    parser.add_argument(
        '--effects-path',
        nargs='+',
        action='extend',
        default=[],
        type=Path,
        metavar='FILE.py',
        help='your own effects; these files are run, so name only what you trust',
    )


def add_bags(made: ArgumentParser) -> None:
    """Add --effects-path, the recordings (positional), and the options of `add_reading`."""
    add_effects_path(made)
    made.add_argument('bags', nargs='+', type=Path, metavar='BAG', help='recordings')
    add_reading(made)


def add_reading(made: ArgumentParser) -> None:
    """Add --drives, --without for seconds to leave out, and options that admit doubts."""
    made.add_argument('--drives', nargs='+', default=[], metavar='NAME', help='only these drives')
    made.add_argument(
        '--without',
        nargs='+',
        default=[],
        metavar='FROM:TO',
        help='leave these seconds out of all judgement, as 12.5:14,30:31; 2@12.5:14 of the second '
        'recording',
    )
    add_doubts(made)


def add_output(made: ArgumentParser, name: str, what: str = 'file to write') -> None:
    """Add a required -o/--output; name: placeholder in the help, whose suffix a file must have."""
    kind = ending('-o', Path(name).suffix)
    made.add_argument('-o', '--output', type=kind, required=True, metavar=name, help=what)


def add_outputs(made: ArgumentParser, *, report: bool = True) -> None:
    """Add --json, and --report for an HTML page unless report is false."""
    made.add_argument('--json', type=Path, metavar='FILE', help='write the result as JSON')
    if report:
        made.add_argument(
            '--report',
            type=ending('--report', '.html'),
            metavar='FILE.html',
            help='write a page to read',
        )


@entry_point(
    'power_lab.commands.add:run',
    'Add an effect to a model: all coefficients are fitted anew, the history is kept.',
    'example: ros2 run power_lab add load_friction --to base.yaml --bag bags/walk -o better.yaml',
)
def add(parser: ArgumentParser, args: Arguments) -> Namespace:
    add_effects_path(parser)
    add = parser.add_argument
    add('effects', nargs='+', metavar='EFFECT', help='what to add')
    add('--to', required=True, type=Path, metavar='MODEL.yaml', help='the model as it is')
    add('--bag', required=True, nargs='+', type=Path, metavar='BAG', help='recordings to fit on')
    add_reading(parser)
    add_output(parser, 'MODEL.yaml')
    add('--per', choices=('type', 'drive'), help='who shares coefficients; as in the model')
    add('--seed', type=int, default=0, help='of the bootstrap')
    add_outputs(parser, report=False)
    return parser.parse_args(args)


@entry_point(
    'power_lab.commands.challenge:run',
    'Record a walk of a simulated robot with an effect hidden in its drives (or none, or one '
    'that no catalogue knows). The answer is sealed in the bag.',
    'example: ros2 run power_lab challenge --seed 7 -o bags/riddle',
)
def challenge(parser: ArgumentParser, args: Arguments) -> Namespace:
    add = parser.add_argument
    add('--seed', type=int, required=True, metavar='N', help='draws what is hidden')
    add('-o', '--output', type=Path, required=True, metavar='BAG', help='folder to write')
    add('--walk', type=int, default=0, metavar='N', help='another walk of the same robot')
    add('--duration', type=float, default=150.0, metavar='S', help='to record (default: 150)')
    add('--plant', default='anymal_c', metavar='FILE', help='plant to hide it in')
    add('--json', type=Path, metavar='FILE', help='write what the model may know as JSON')
    add('--overwrite', action='store_true', help='replace a bag that is there')
    options = parser.parse_args(args)
    for name in ('seed', 'walk'):
        if getattr(options, name) < 0:
            raise InputError(f'--{name} {getattr(options, name)}: give a number from 0')
    if not 30.0 <= options.duration <= 3600.0:
        raise InputError(f'--duration {options.duration:g}: it must lie in 30..3600 s')
    return options


@entry_point(
    'power_lab.commands.challenge:reveal',
    'Open the sealed answer of a challenge.',
    'example: ros2 run power_lab reveal bags/riddle --diagnosis why.json',
)
def reveal(parser: ArgumentParser, args: Arguments) -> Namespace:
    add = parser.add_argument
    add('bag', type=Path, metavar='BAG', help='written by challenge')
    add('--diagnosis', type=Path, metavar='FILE.json', help='what diagnose --json wrote')
    add('--json', type=Path, metavar='FILE', help='write the answer as JSON')
    return parser.parse_args(args)


@entry_point(
    'power_lab.commands.budget:run',
    'Where the metered power goes: by effect, drive, type of drive and phase of the motion, '
    'with 90 % intervals, and what changes of the drives would save. Without a model one is '
    'chosen by its error on held-out data. Several recordings are compared with the first.',
    'example: ros2 run power_lab budget bags/walk --battery 907Wh --report budget.html',
)
def budget(parser: ArgumentParser, args: Arguments) -> Namespace:
    add_bags(parser)
    add = parser.add_argument
    add('--model', metavar='MODEL.yaml', help='model of effects (default: one is chosen)')
    add('--battery', type=watt_hours, metavar='907Wh', help='give the hours that it lasts')
    add(
        '--change',
        default='',
        metavar='LEVER=FACTOR,…',
        help='what these change, at the same motion of the joints, instead of 10 %% of each: '
        'gear_ratio, supply_voltage, winding_resistance, friction, idle, payload (weight that '
        'standing legs carry)',
    )
    add('--figures', type=Path, metavar='FOLDER', help='write the pictures as svg and png')
    add('--seed', type=int, default=0, help='of the intervals')
    add_workplace(parser, 'recordings read')
    add_outputs(parser)
    return parser.parse_args(args)


@entry_point(
    'power_lab.commands.compare:run',
    'Compare power models with measurements on held-out data: error, bias, energy, and the '
    'regimes in which each model is worst.',
    'example: ros2 run power_lab compare bags/walk --models base.yaml better.yaml '
    'mechanical_power --report compare.html',
)
def compare(parser: ArgumentParser, args: Arguments) -> Namespace:
    add_bags(parser)
    parser.add_argument(
        '--models',
        nargs='+',
        required=True,
        metavar='MODEL',
        help='model.yaml, ppn:RUN or a proxy',
    )
    add_workplace(parser, 'recordings read')
    add_outputs(parser)
    options = parser.parse_args(args)
    if len(set(options.models)) < len(options.models):
        raise InputError(f'--models names a model twice: {", ".join(options.models)}')
    return options


@entry_point(
    'power_lab.commands.diagnose:run',
    'Find the physical effect that a power model misses, or say honestly that these '
    'recordings cannot tell. Ends with 0 for every verdict.',
    'example: ros2 run power_lab diagnose bags/walk --model base.yaml --report why.html',
)
def diagnose(parser: ArgumentParser, args: Arguments) -> Namespace:
    add_bags(parser)
    add = parser.add_argument
    add('--model', required=True, metavar='MODEL', help='model.yaml, ppn:RUN or a proxy')
    add(
        '--motion',
        type=ending('--motion', '.yaml'),
        metavar='FILE.yaml',
        help='write what to record next',
    )
    add(
        '--limits',
        nargs='?',
        const='',
        metavar='FILE',
        help='fit that motion to joint_limits/1; without a file: to the limits of ANYmal C',
    )
    add('--also', nargs='+', default=[], metavar='MODEL', help='models to show beside it')
    add('--seed', type=int, default=0, help='of the bootstrap')
    add_workplace(parser, 'recordings read')
    add_outputs(parser)
    return parser.parse_args(args)


@entry_point(
    'power_lab.commands.discover:run',
    'Learn what a model misses and no catalogue has: what it depends on, its shape and a '
    'formula, written as an effect that add takes. Where nothing is found no file is written. '
    'Of several recordings the last tests what the others show, unless --test names one.',
    'example: ros2 run power_lab discover bags/walk --test bags/other --model base.yaml '
    '-o effect.py --report why.html',
)
def discover(parser: ArgumentParser, args: Arguments) -> Namespace:
    add_bags(parser)
    add = parser.add_argument
    add('--model', required=True, metavar='MODEL', help='model.yaml, ppn:RUN or a proxy')
    add_output(parser, 'FILE.py', 'effects to write')
    add(
        '--test',
        nargs='+',
        default=[],
        type=Path,
        metavar='BAG',
        help='other recordings of the robot, to test the effects on',
    )
    add('--seed', type=int, default=0, help='of the bootstrap')
    add_outputs(parser)
    return parser.parse_args(args)


@entry_point(
    'power_lab.commands.drives:run',
    'List the library of real drives that were identified from public logs, show one, or '
    'write it as an actuator with its power.',
    'example: ros2 run power_lab drives mn8014_sspg_7 --export mujoco',
)
def drives(parser: ArgumentParser, args: Arguments) -> Namespace:
    add = parser.add_argument
    add('name', nargs='?', metavar='NAME', help='drive to show; without one all are listed')
    add('--export', choices=('mujoco', 'mjlab'), help='print the actuator: MJCF, or Python')
    add_outputs(parser, report=False)
    options = parser.parse_args(args)
    if options.export and not options.name:
        raise InputError('--export: name the drive; `drives` alone lists them')
    return options


@entry_point(
    'power_lab.commands.execute:run',
    'Record the motion that diagnose asked for (--motion) with one drive of the simulated bench.',
    'example: ros2 run power_lab execute next.yaml --drive LF_KFE -o bags/next',
)
def execute(parser: ArgumentParser, args: Arguments) -> Namespace:
    add = parser.add_argument
    add('motion', type=Path, metavar='MOTION.yaml', help='written by diagnose --motion')
    add('-o', '--output', type=Path, required=True, metavar='BAG', help='folder to write')
    add('--drive', metavar='NAME', help='default: the first that the motion names')
    add('--plant', default='anymal_c', metavar='FILE', help='plant file, or a shipped plant')
    add('--challenge', type=Path, metavar='BAG', help='the robot of a challenge, still sealed')
    add('--unit', type=int, default=0, metavar='N', help='unit of the plant')
    add('--seed', type=int, default=0, help='of the noise')
    add('--overwrite', action='store_true', help='replace a bag that is there')
    return parser.parse_args(args)


@entry_point(
    'power_lab.commands.fit:run',
    'Fit a power model made of named effects; errors of the measurement are fitted beside them.',
    'example: ros2 run power_lab fit bags/walk --effects shaft,copper_loss,idle -o base.yaml',
)
def fit(parser: ArgumentParser, args: Arguments) -> Namespace:
    add_bags(parser)
    add = parser.add_argument
    add(
        '--effects',
        nargs='+',
        required=True,
        metavar='NAME,…',
        help='what is active; `all` lists what there is',
    )
    add_output(parser, 'MODEL.yaml')
    add('--per', choices=('type', 'drive'), default='type', help='who shares coefficients')
    add('--base', metavar='MODEL', help='add the effects to this model: ppn:RUN or a proxy')
    add(
        '--prior',
        metavar='drive:NAME',
        help='start from a drive of the library (power_lab drives): it decides what the recording '
        'does not',
    )
    add('--seed', type=int, default=0, help='of the bootstrap')
    add_outputs(parser, report=False)
    options = parser.parse_args(args)
    if options.base and options.base.endswith('.yaml'):
        raise InputError(f'--base {options.base!r}: give ppn:RUN or a proxy; add effects by add')
    return options


@entry_point(
    'power_lab.commands.to_plant:run',
    "Write a plant file for the simulator with a model's effects at their fitted strength.",
    'example: ros2 run power_lab to_plant better.yaml -o plant.yaml && '
    'ros2 run sim_bridge sim --offline --plant plant.yaml -o bags/like_the_robot',
)
def to_plant(parser: ArgumentParser, args: Arguments) -> Namespace:
    add_effects_path(parser)
    add = parser.add_argument
    add('model', type=Path, metavar='MODEL.yaml', help='fitted model')
    add('--plant', default='anymal_c', metavar='FILE', help='plant to start from')
    add_output(parser, 'PLANT.yaml')
    add_outputs(parser, report=False)
    return parser.parse_args(args)
