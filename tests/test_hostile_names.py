"""Names of models and policies that stand for nothing are refused in one printable line."""

import pytest
from policy_runner.policies.by_name import load_policy
from power_estimator.loader import load_model
from wattwalk_core.errors import InputError

SPECS = [
    *('', 'ppn:', 'ppn', 'torque', 'torque_squared\n', 'TORQUE_ABS', 'ppn:\x1b[31m', '\x00'),
    *('ppn:\x00', 'ppn:/dev/zero', '/dev/zero', '\x00.yaml', 'x' * 5000, 'ppn:' + 'x' * 5000),
    *('x' * 5000 + '.yaml', 'no.yaml', '..yaml', 'ppn:.', '.', '/'),
]


@pytest.mark.parametrize('spec', SPECS, ids=range(len(SPECS)))
@pytest.mark.parametrize('load', [load_model, load_policy])
def test_a_name_that_stands_for_nothing_is_refused(load, spec):
    with pytest.raises(InputError) as raised:
        load(spec)
    assert str(raised.value).isprintable()


@pytest.mark.parametrize('suffix', ['.pt', '.pth', '.jit', '.ts'])
def test_torchscript_is_refused_unless_its_code_is_trusted(tmp_path, suffix):
    (tmp_path / f'walk{suffix}').write_bytes(b'PK')
    with pytest.raises(InputError, match='--trust-code'):
        load_policy(str(tmp_path / f'walk{suffix}'))
