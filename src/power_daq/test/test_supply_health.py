from power_daq.supply.answers import InstrumentIdentity, ScpiError
from power_daq.supply.energy_counters import Balance, Energy
from power_daq.supply.poller import PollState, SupplyHealth
from wattwalk_core.nodes.diagnostics import Level

NAMES = ('LF_HAA', 'LF_HFE', 'LF_KFE', 'RF_HAA', 'RF_HFE')


class Poller:
    """State of a poller as a health report reads it."""

    def __init__(self):
        self.state = PollState(InstrumentIdentity('EA', 'PSB 9080', '17', 'V3'), absence='')
        self.lost = 0

    def take_worst_round_trip(self):
        return 0.0021


class Watch:
    """Reports a second apart, with 100 readings in each."""

    def __init__(self):
        self.poller = Poller()
        self.health = SupplyHealth(self.poller, 100.0, 'TCPIP::x::5025::SOCKET')
        self.now = 0.0
        self.report()

    def report(self, readings=100, balance=None, energy=None):
        self.now += 1.0
        self.poller.state.counts.readings += readings
        return self.health.report(self.now, energy or Energy(), balance)


def test_a_supply_that_is_read_at_its_rate_is_measuring():
    report = Watch().report(energy=Energy(3600.0, 36.0, 1.5))
    assert (report.level, report.sentence) == (Level.OK, 'measuring')
    assert report.figures['identity'] == 'EA, PSB 9080, 17, V3'
    assert report.figures['rate [Hz]'] == '100.0'
    assert report.figures['worst round trip [ms]'] == '2.10'
    assert report.figures['energy [Wh]'] == '1.0000'
    assert report.figures['energy not counted for [s]'] == '1.50'


def test_a_supply_that_is_absent_is_an_error_with_the_reason():
    watch = Watch()
    watch.poller.state.absence = 'no answer to *IDN?'
    report = watch.report(0)
    assert (report.level, report.sentence) == (Level.ERROR, 'supply absent: no answer to *IDN?')


def test_faults_are_named_once_in_the_second_in_which_they_happened():
    watch = Watch()
    watch.poller.lost = 3
    watch.poller.state.counts.not_an_answer += 1
    watch.poller.state.counts.instrument_errors += 1
    watch.poller.state.last_errors = [ScpiError(-113, 'Undefined header')]
    report = watch.report(97)
    assert report.level is Level.WARN
    assert report.sentence == (
        'in the last second: 1 not an answer, 1 instrument errors, 3 readings lost '
        '(-113 Undefined header)'
    )
    assert watch.report().level is Level.OK


def test_a_supply_that_is_read_too_slowly_is_a_warning():
    report = Watch().report(60)
    assert (report.level, report.sentence) == (Level.WARN, 'supply at 60 Hz, not 100 Hz')


def balance(supply, drives, seconds=30):
    return Balance(supply, drives, supply - drives, seconds, NAMES)


def test_what_the_drives_leave_over_is_shown():
    report = Watch().report(balance=balance(120.0, 96.0))
    figures = report.figures
    assert report.level is Level.OK
    assert figures['drives compared'] == '5: LF_HAA, LF_HFE, LF_KFE, RF_HAA, …'
    assert figures['supply minus drives (electronics), mean of 1 s [W]'] == '24.00'
    assert figures['supply minus drives (electronics), mean of 30 s [W]'] == '24.00'


def test_drives_that_draw_more_than_the_supply_gives_are_a_warning():
    watch = Watch()
    report = watch.report(balance=balance(100.0, 130.0))
    assert report.level is Level.WARN
    assert 'the drives draw 30.0 W more than the supply gives: check signs' in report.sentence
    assert watch.report(balance=balance(100.0, 104.0)).level is Level.OK, 'within both meters'
    assert watch.report(balance=balance(100.0, 130.0, 3)).level is Level.OK, 'too early to tell'
