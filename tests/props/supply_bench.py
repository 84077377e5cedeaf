"""A supply's poller and a simulated instrument that it asks over real TCP on loopback."""

import itertools
import time

from kept_log import KeptLog
from power_daq.supply.instrument import Instrument, InstrumentSettings
from power_daq.supply.poller import Poller
from sim_bridge.instruments.scpi import ScpiInstrument, SupplyState, Terminals, whole

PATIENCE = 120.0


class Bench:
    """An instrument whose current rises with every look at it, and what a poller reads of it."""

    def __init__(self):
        self.count = itertools.count(1)
        self.asked = {}
        self.state = SupplyState(self.terminals)
        self.instrument = ScpiInstrument(self.state)
        self.port = self.instrument.port
        self.readings, self.said = [], KeptLog()
        self.poller = None

    def terminals(self):
        current = round(next(self.count) / 100, 2)
        self.asked[current] = time.time_ns()
        return Terminals(48.0, current)

    def poll(self, rate=100.0, timeout=5.0, prepare=None, **options):
        settings = InstrumentSettings('127.0.0.1', self.port, timeout, **options)
        self.poller = Poller(
            lambda: Instrument(settings),
            self.readings.append,
            rate,
            self.said,
            (0.01, 0.05),
            prepare,
        )
        self.poller.start()
        return self.poller

    def until(self, condition):
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, f'waited in vain; it said {self.said}'
            if self.poller is not None and self.poller.failed:
                self.poller.join()
            time.sleep(0.01)

    def read(self, more=20):
        """Wait for more readings."""
        enough = len(self.readings) + more
        self.until(lambda: len(self.readings) >= enough)

    @property
    def counts(self):
        return self.poller.state.counts

    def spoil(self, how, every=5):
        """From now on, answer every so many MEAS:ARR? by how(answer)."""
        number = itertools.count(1)

        def send(question, answer):
            if question.startswith('MEAS:ARR') and next(number) % every == 0:
                return how(answer)
            return whole(question, answer)

        self.instrument.send = send

    def close(self):
        if self.poller is not None:
            self.poller.stop()
            self.poller.join(PATIENCE)
        self.instrument.close()
