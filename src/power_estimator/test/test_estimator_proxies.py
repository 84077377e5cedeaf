from dataclasses import replace

import numpy as np
import pytest
from power_estimator.loader import load_model
from power_estimator.proxies import PROXIES, Proxy
from wattwalk_core.errors import InputError


@pytest.mark.parametrize('name', PROXIES)
def test_a_proxy_has_the_mean_of_what_was_measured_per_drive_type(drives, name):
    data = drives(10.0, ('LF_HAA', 'LF_HFE', 'RF_HAA'))
    power = load_model(name).predict(data)
    for columns in ([0, 2], [1]):
        assert power[:, columns].mean(dtype=float) == pytest.approx(
            data.power[:, columns].mean(dtype=float), rel=1e-4
        )


def test_proxies_by_hand(drives):
    data = drives(1.0, ('LF_HAA',))
    data.torque[:4, 0] = [1, -2, 3, -4]
    data.velocity[:4, 0] = [2, 3, -1, -5]
    data = data.rows(slice(0, 4))
    assert PROXIES['torque_squared'](data)[:, 0].tolist() == [1, 4, 9, 16]
    assert PROXIES['torque_abs'](data)[:, 0].tolist() == [1, 2, 3, 4]
    assert PROXIES['mechanical_power'](data)[:, 0].tolist() == [2, 6, 3, 20]
    assert PROXIES['mechanical_power_positive'](data)[:, 0].tolist() == [2, 0, 0, 20]
    # differences 1, (−1−2)/2, (−5−3)/2, −4 rad/s per 5 ms
    squares = [200**2, 300**2, 800**2, 800**2]
    assert PROXIES['acceleration_squared'](data)[:, 0] == pytest.approx(squares, rel=1e-4)


def test_acceleration_does_not_look_across_segments(drives):
    data = drives(0.1, ('LF_HAA',), segments=2)
    data.velocity[:10] = 0
    data.velocity[10:] = 7
    assert PROXIES['acceleration_squared'](data).max() == 0


def test_a_fitted_proxy_keeps_its_factor_on_other_data(drives):
    training, other = drives(10.0, seed=1), drives(10.0, seed=2)
    fitted = Proxy('torque_squared').fit(training)
    factors = [
        fitted.predict(data).sum(axis=0) / (data.torque**2).sum(axis=0)
        for data in (training, other)
    ]
    assert factors[0] == pytest.approx(factors[1], rel=1e-4)
    assert Proxy('torque_squared').fit(other).factors != fitted.factors


def test_a_proxy_without_measured_power_says_what_it_needs(drives):
    data = drives(1.0)
    dark = replace(data, power=np.full_like(data.power, np.nan))
    with pytest.raises(InputError, match=r'torque_abs has no unit of power.*synthetic has none'):
        Proxy('torque_abs').predict(dark)


def test_a_drive_of_a_type_that_was_not_measured_is_unknown(drives):
    fitted = Proxy('torque_abs').fit(drives(1.0, ('LF_HAA',)))
    power = fitted.predict(drives(1.0, ('RF_HAA', 'RF_KFE')))
    assert np.isfinite(power[:, 0]).all()
    assert np.isnan(power[:, 1]).all()
