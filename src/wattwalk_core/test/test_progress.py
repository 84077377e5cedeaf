"""Progress of commands where no terminal is."""

from wattwalk_core import console


def test_without_a_terminal_a_line_comes_each_ten_seconds(monkeypatch, capsys):
    seconds = iter([100.0, 104.0, 111.0, 115.0, 122.0])  # of the clock, at the start and each call
    monkeypatch.setattr(console.time, 'monotonic', lambda: next(seconds))
    monkeypatch.setattr('rich.progress.Progress.update', lambda *given, **named: None)
    monkeypatch.setattr('rich.progress.Progress.start', lambda self: None)
    monkeypatch.setattr('rich.progress.Progress.stop', lambda self: None)
    monkeypatch.setattr('rich.progress.Progress.add_task', lambda self, text: 0)
    with console.progress('reading') as show:
        for text in ('a', 'b', 'c', 'd'):
            show(text)
    assert capsys.readouterr().err == '11 s: b\n22 s: d\n'
