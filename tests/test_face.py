"""What a person meets first: the command without arguments, its help, its version, its completion."""

import io
import subprocess
import sys
import time

import pytest

from testfield.chain import progress
from testfield.cli.colour import bad, good
from testfield.cli.main import main, parser
from testfield.version import __version__

TOOLS = ("render", "detect", "recall", "adjust", "claims")


def test_the_command_alone_shows_every_command(capsys: pytest.CaptureFixture) -> None:
    assert main([]) == 0
    shown = {line.split()[0] for line in capsys.readouterr().out.splitlines() if line.startswith("  ")}
    assert shown >= set(parser().commands.help)
    assert len(shown) > 18


def test_the_version_is_said(capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SystemExit) as end:
        main(["--version"])
    assert end.value.code == 0 and capsys.readouterr().out == f"testfield {__version__}\n"


def test_each_bench_tool_shows_its_own_options_only(capsys: pytest.CaptureFixture) -> None:
    own = {"render": "--scene", "detect": "--only", "recall": "--empty", "adjust": "--quick", "claims": "--trials"}
    for tool in TOOLS:
        with pytest.raises(SystemExit):
            main(["bench", tool, "--help"])
        said = capsys.readouterr().out
        assert own[tool] in said and "--json" in said
    with pytest.raises(SystemExit):
        main(["bench", "adjust", "--trials", "3"])


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys; from testfield.cli.main import parser; parser().format_help();"
        "print(*[m for m in ('numpy', 'scipy', 'cv2', 'pydantic', 'mitsuba', 'shtab', 'tqdm') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


@pytest.mark.parametrize("shell", ["bash", "zsh", "tcsh"])
def test_a_shell_is_given_every_command(shell: str, capsys: pytest.CaptureFixture) -> None:
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert all(name in script for name in parser().commands.help)


def test_bash_completes_a_command() -> None:
    source = f"{sys.executable} -m testfield completion bash"
    script = (
        f'eval "$({source})"; COMP_WORDS=(testfield vali); COMP_CWORD=1; _shtab_testfield; echo "${{COMPREPLY[@]}}"'
    )
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=False)
    assert done.stdout.split() == ["validate"], done.stderr


def test_colour_is_for_terminals_that_want_it(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal, file = io.StringIO(), io.StringIO()
    monkeypatch.setattr(terminal, "isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    assert good("passed", file) == "passed" and good("passed", terminal) != bad("passed", terminal) != "passed"
    monkeypatch.setenv("NO_COLOR", "1")
    assert good("passed", terminal) == "passed"


def test_a_log_hears_of_slow_work_and_not_of_none(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.setattr(progress, "SILENT_S", 0.05)
    monkeypatch.setattr(progress, "LEAST_S", 0.0)
    monkeypatch.setattr(progress, "EVERY_S", 0.2)
    with progress.bar("quick", 4, "views") as move:
        move(4)
    assert capsys.readouterr().err == ""
    with progress.bar("slow", 20, "views") as move:
        time.sleep(0.15)
        move(1)
        time.sleep(0.35)  # one long view: a line says that it goes on
        for _ in range(19):
            move(1)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0].startswith("slow: 0 of 20 views") and lines[-1].startswith("slow: 20 of 20 views in")
    assert sum("1 of 20 views (5 %)" in line and "to go" in line for line in lines) >= 1
    assert 8 <= sum("to go" in line for line in lines) <= 12


def test_a_stage_without_steps_of_its_own_is_not_silent_either(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.setattr(progress, "SILENT_S", 0.05)
    monkeypatch.setattr(progress, "EVERY_S", 0.1)
    with progress.step("calibrate"):
        time.sleep(0.3)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) >= 3 and lines[-1].startswith("calibrate: done in")
