"""Arguments of the commands."""

from argparse import ArgumentParser, Namespace
from pathlib import Path

from drive_bench.motion.file import MOTIONS, listing
from drive_bench.motion.segments import UNITS
from policy_runner.policies.by_name import POLICIES
from policy_runner.policies.velocity_commands import CommandRange, parse_velocity
from wattwalk_core.anymal import JOINT_NAMES
from wattwalk_core.command import Arguments, entry_point, node_options, own_arguments
from wattwalk_core.engine.options import Workplace, add_workplace
from wattwalk_core.errors import InputError

from sim_bridge.plant.terrain import TERRAINS

SECONDS = {'paper': 600.0, 'robustness': 150.0}
SEED = 21
_BENCH = f"""motions:
{listing()}

They are those of `ros2 run drive_bench run`, which runs them on a drive.

examples:
  ros2 run sim_bridge bench sine -o bags/sine
  ros2 run sim_bridge bench ladder --mode velocity --duration 40 -o bags/ladder
  ros2 run sim_bridge bench holds --load 4kg@0.3m --drive RH_HFE -o bags/holds
  ros2 run sim_bridge bench sine --frequency 4.0371 --unit 3 -o bags/fig2 --analyser fig2.csv
"""


@entry_point(
    'sim_bridge.commands.bench:run',
    'Record one simulated drive on a stand, as fast as the machine can.',
    _BENCH,
)
def bench(parser: ArgumentParser, args: Arguments) -> Namespace:
    add = parser.add_argument
    add('motion', metavar='MOTION', help=f'{", ".join(MOTIONS)}, or a motion/1 file')
    add('-o', '--output', type=Path, required=True, metavar='BAG', help='folder to write')
    add('--mode', choices=tuple(UNITS), help='one that the motion has; default: its first')
    add('--amplitude', type=float, metavar='X', help='in the unit of the mode')
    add('--frequency', type=float, metavar='HZ')
    add('--duration', type=float, metavar='S', help='of each segment with an amplitude')
    add('--drive', choices=JOINT_NAMES, default='LF_KFE', metavar='NAME', help='such as LF_KFE')
    add('--inertia', type=float, default=0.02, metavar='J', help='of the disc it turns, kg·m²')
    add('--load', metavar='KG@M', help='weight on an arm, such as 4kg@0.3m')
    add('--mass', type=float, default=0.0, metavar='M', help='of the same weight, kg')
    add('--length', type=float, default=0.3, metavar='L', help='of its arm, m')
    add('--seed', type=int, default=0, help='of the noise')
    add('--plant', default='anymal_c', metavar='FILE', help='plant file, or a shipped plant')
    add('--unit', type=int, metavar='N', help='draw the spread of another unit')
    add('--overwrite', action='store_true', help='replace a bag that is there')
    add = parser.add_argument_group('a power analyser beside the meter').add_argument
    add('--analyser', type=Path, metavar='FILE.csv', help='write what it logs')
    add('--analyser-rate', type=float, default=20_000.0, metavar='HZ', help='rows per second')
    add('--analyser-offset', type=float, default=0.0, metavar='S', help='its clock at the start')
    add('--analyser-drift', type=float, default=0.0, metavar='PPM', help='of its clock')
    return parser.parse_args(own_arguments(args))


_RECORD = """\
sets:
  paper       HAA, HFE, KFE: ten minutes each with one drive of that type metered, on rough
              ground (±2 cm, slopes to 2 %) and pushed (Section II-A).
  ageing      a unit that ages day by day, by the plan of --plan FILE.yaml.
  robustness  trot_slow, trot_high, unit: 150 s each of other gaits and of another unit of the
              robot on level ground, all drives metered (Section III-B).

All walk by random velocity commands, side by side, one to a core. A seed belongs to a recording:
it does not depend on the number of workers. Recordings that are there already are kept; what was
broken off is recorded anew.

examples:
  ros2 run sim_bridge record paper -o bags/paper
  ros2 run sim_bridge record robustness -o bags/robustness --seconds 120
  ros2 run power_estimator train bags/paper/* -o runs/paper
"""


@entry_point(
    'sim_bridge.commands.record:run',
    'Make a set of recordings of the simulated robot, to train and judge on.',
    _RECORD,
)
def record(parser: ArgumentParser, args: Arguments) -> Namespace:
    add = parser.add_argument
    add('set', choices=(*SECONDS, 'ageing'), help='which recordings to make')
    add('--plan', type=Path, metavar='FILE.yaml', help='of the set ageing: wear and days')
    add('-o', '--output', type=Path, required=True, metavar='FOLDER', help='of the recordings')
    add('--seconds', type=float, metavar='S', help='of each recording (600 or 150)')
    add('--seed', type=int, default=SEED, help='of commands, noise, terrain and pushes')
    add('--plant', default='anymal_c', metavar='FILE', help='plant file, or a shipped plant')
    walkers = 'of the set paper: policies that each walk all of it, by name or folder (trot)'
    add('--controllers', nargs='+', default=['trot'], metavar='POLICY', help=walkers)
    add('--fastest', metavar='VX,VY,YAW', help='of its random commands, also mixed')
    add_workplace(parser, 'recordings')
    options = parser.parse_args(own_arguments(args))
    options.place = Workplace.of(options)
    if (options.set == 'ageing') != (options.plan is not None):
        raise InputError('--plan FILE.yaml belongs to the set ageing; give both or neither')
    for name, default in (('controllers', ['trot']), ('fastest', None)):
        if options.set != 'paper' and getattr(options, name) != default:
            raise InputError(f'--{name} belongs to the set paper; {options.set} has its own')
    if options.fastest is not None:
        options.fastest = parse_velocity(options.fastest, '--fastest')
        CommandRange.up_to(options.fastest)  # its ranges
    return options


_SIM = """\
Without --offline this is the node `sim_bridge`: the plant in real time behind a CAN bus. Its
settings are ROS parameters: plant, unit, terrain, seed, world (anymal_c or bench), publish_clock,
reset_after_fall, push_velocity, push_direction. Of the bus: interface (unixsocket, virtual,
socketcan), channel, dbc, mapping. Of the bench: joint, and inertia, mass and length of the
pendulum that it swings. Services: push, reset.

examples:
  ros2 run sim_bridge sim --ros-args -p channel:=/tmp/wattwalk.sock
  ros2 run sim_bridge sim --offline --seed 1 --duration 60 -o bags/walk --pushes
  ros2 run sim_bridge sim --offline --velocity=0,0,0.7 --duration 30 -o bags/turn
"""


@entry_point(
    'sim_bridge.commands.sim:run', 'The simulated robot, its drives and their power meter.', _SIM
)
def sim(parser: ArgumentParser, args: Arguments) -> Namespace:
    add = parser.add_argument
    add('--offline', action='store_true', help='write a bag as fast as the machine can')
    add = parser.add_argument_group('with --offline').add_argument
    add('--seed', type=int, default=0, help='of commands, noise, terrain and pushes')
    add('--duration', type=float, default=60.0, metavar='S', help='seconds to simulate')
    add('-o', '--output', type=Path, metavar='BAG', help='folder of the bag to write')
    add('--plant', default='anymal_c', metavar='FILE', help='plant file, or a shipped plant')
    add('--unit', type=int, metavar='N', help='draw the spread of another unit of the robot')
    add('--terrain', choices=TERRAINS, default='flat')
    add('--controller', default='trot', help=f'{", ".join(POLICIES)}, stand, or a policy folder')
    add('--trust-code', action='store_true', help='run TorchScript files, which are code')
    add('--velocity', metavar='VX,VY,YAW', help='hold it (m/s, m/s, rad/s) instead of random ones')
    add('--pushes', action='store_true', help='push the robot every few seconds')
    add('--drives', metavar='A,B', help='meter only these drives, such as LF_KFE,RF_KFE')
    add('--overwrite', action='store_true', help='replace a bag that is there')
    return node_options(parser, args)


_ETHERCAT_SEGMENT = """
Needs root, for raw sockets. example, on a cable of two virtual ends:
  ip link add ecat0 type veth peer name ecat1
  ip link set ecat0 up; ip link set ecat1 up
  ros2 run sim_bridge ethercat_segment --interface ecat1 --volts 4.8 0.4
  ros2 run power_daq daq --ros-args -p interface:=ethercat -p channel:=ecat0 \\
      -p mapping:=ethercat.yaml
"""
_VOLTS = 'at the inputs, two for each terminal'


@entry_point(
    'sim_bridge.instruments.ethercat.terminals:run',
    'Emulates an EK1100 and an EL3102 for each two voltages, to try power_daq without hardware.',
    _ETHERCAT_SEGMENT,
)
def ethercat_segment(parser: ArgumentParser, args: Arguments) -> Namespace:
    add = parser.add_argument
    add('--interface', required=True, metavar='NAME', help='such as ecat1')
    add('--volts', '-v', type=float, nargs='+', default=[4.8, 0.4], metavar='V', help=_VOLTS)
    return parser.parse_args(own_arguments(args))


_SUPPLY_INSTRUMENT = """
example, a constant load:
  ros2 run sim_bridge supply_instrument --ros-args -p voltage:=48.0 -p current:=3.0
  ros2 run power_daq supply --ros-args -p host:=127.0.0.1
example, what the simulated robot draws (its own supply goes to another topic):
  ros2 run sim_bridge sim --ros-args -r supply:=simulated_supply
  ros2 run sim_bridge supply_instrument
  ros2 run power_daq supply --ros-args -p host:=127.0.0.1
"""


@entry_point(
    'sim_bridge.instruments.supply_node:run',
    'A simulated bench supply that speaks SCPI over TCP, to try power_daq supply '
    'without hardware.',
    _SUPPLY_INSTRUMENT,
)
def supply_instrument(parser: ArgumentParser, args: Arguments) -> Namespace:
    return node_options(parser, args)
