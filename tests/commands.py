"""Commands that tests of the command line give."""

from equipoise.cli import main


def fails(capsys, code, *arguments):
    """Run, expect that exit code and one clear sentence on stderr, and return it."""
    assert main(list(arguments)) == code
    captured = capsys.readouterr()
    assert "Traceback" not in captured.err
    lines = [line for line in captured.err.splitlines() if line.startswith("error: ")]
    assert len(lines) == 1
    return lines[0]
