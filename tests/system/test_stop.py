"""Ctrl-C, SIGTERM and SIGHUP end the command at any moment: with one line, and nothing is lost or left behind."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mcstudy.cli import main
from mcstudy.cli.verbs import verbs
from mcstudy.exits import Exit
from mcstudy.files.durable import PARTIAL, tree_digest

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

HUNG_S = 60
"""After which a command counts as hung. The promise is 2 s (`ctrl_c` measures it); a busy machine has its time."""

STUDY = """
[study]
name = "small"
seed = 7

[group.noisy]
realizations = 40
starts = 20
fmax = [1.2]
amplitude = [5.0]
"""

# `mcstudy show OUT` that does something else.
PROGRAM = """
import hashlib, sys, threading, time
from pathlib import Path
import mcstudy.cli.verbs.show as verb
from mcstudy.files.durable import replacing
from mcstudy.files.unfinished import scratch_folder

def swallows():
    while True:
        try:
            ready()
            time.sleep(1000)
        except BaseException:
            pass

def native():
    ready()
    hashlib.pbkdf2_hmac("sha256", b"", b"", 2**31 - 1)  # many minutes without a line of Python

def writes():
    with replacing(Path(sys.argv[2])) as file, scratch_folder("mcstudy-test-") as folder:
        file.write(b"half")
        (folder / "inside").mkdir()
        threading.Thread(target=fills, args=(folder / "inside",), daemon=True).start()
        ready()
        time.sleep(1000)

def fills(folder):
    try:
        for k in range(10**9):
            (folder / str(k)).touch()
    except OSError:  # the folder is gone, as it should be
        pass

def ready():
    print("ready", flush=True)

verb.main = lambda args: {work}()
from mcstudy.cli import main
sys.exit(main())
"""


def heard() -> None:
    """What a process is to have that is started: signals that are not ignored, whatever started this one ignores."""
    for sign in SIGNALS:
        signal.signal(sign, signal.SIG_DFL)


def start(*words: str, folder: Path, cold: bool = False) -> subprocess.Popen[str]:
    """A command whose temporary files are below ``folder``, as its compiled code when it is to compile (``cold``)."""
    (folder / "temporary").mkdir(exist_ok=True)
    variables = {**os.environ, "TMPDIR": str(folder / "temporary")}
    if cold:
        variables["NUMBA_CACHE_DIR"] = str(folder / "compiled")
    return subprocess.Popen(
        [sys.executable, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=variables,
        preexec_fn=heard,
    )


def wait_until_signals_are_caught(process: subprocess.Popen[str]) -> None:
    """Before its first line is run it is not this program that hears a signal, but Python or the system."""
    status = Path(f"/proc/{process.pid}/status")
    if not status.exists():
        time.sleep(1)  # not Linux
        return
    while True:
        assert process.poll() is None, process.communicate()
        (caught,) = (line.split()[1] for line in status.read_text().splitlines() if line.startswith("SigCgt:"))
        if int(caught, 16) & 1 << signal.SIGHUP - 1:
            return
        time.sleep(0.001)


def ends(process: subprocess.Popen[str], *signs: signal.Signals, between_s: float = 0.0) -> tuple[int, str]:
    """Send signals; the exit code and the one line that is said, of a process that ends soon, without a traceback."""
    for sign in signs:
        process.send_signal(sign)
        time.sleep(between_s)
    try:
        _, errors = process.communicate(timeout=HUNG_S)
    finally:
        process.kill()
    said = [line for line in errors.splitlines() if line.startswith("mcstudy: ")]
    assert "Traceback" not in errors
    assert "Error" not in errors
    assert errors.count("stopping: ") <= 1
    assert len(said) == 1, errors
    return process.returncode, said[0]


def left_in(folder: Path) -> list[str]:
    """Files that are neither results nor what Dask tidies up at its next start; a cube that was begun is one."""
    found = [p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()]
    return [name for name in found if PARTIAL in name or name.startswith(("temporary/mcstudy", ".out.zarr"))]


@pytest.fixture
def study(tmp_path: Path) -> Path:
    file = tmp_path / "small.toml"
    file.write_text(STUDY)
    return file


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Digest of an undisturbed run."""
    folder = tmp_path_factory.mktemp("whole")
    (folder / "small.toml").write_text(STUDY)
    assert main(["run", str(folder / "small.toml"), "-o", str(folder / "out.zarr")]) == Exit.DONE
    return tree_digest(folder / "out.zarr")


@pytest.mark.parametrize(
    ("wait_s", "sign"), [(w, SIGNALS[k % 3]) for k, w in enumerate((0, 0.02, 0.05, 0.1, 0.2, 0.4, 0.8, 1.5))]
)
def test_a_run_ends_soon_after_a_signal_at_any_moment(study: Path, wait_s: float, sign: signal.Signals) -> None:
    study.write_text(STUDY.replace("realizations = 40", "realizations = 40000"))
    out = study.with_name("out.zarr")
    process = start("-m", "mcstudy", "run", str(study), "-o", str(out), folder=study.parent)
    wait_until_signals_are_caught(process)
    time.sleep(wait_s)
    code, said = ends(process, sign)
    assert code == Exit.INTERRUPTED
    assert said.endswith(f"run the same command again to resume: mcstudy run {study} -o {out}")
    assert left_in(study.parent) == []


@pytest.mark.parametrize(("wait_s", "between_s"), [(0.0, 0.0), (0.4, 0.01), (1.5, 0.05)])
def test_pressed_twice_is_one_line_too(study: Path, wait_s: float, between_s: float) -> None:
    study.write_text(STUDY.replace("realizations = 40", "realizations = 40000"))
    process = start("-m", "mcstudy", "run", str(study), "-o", str(study.with_name("out.zarr")), folder=study.parent)
    wait_until_signals_are_caught(process)
    time.sleep(wait_s)
    code, _ = ends(process, signal.SIGINT, signal.SIGINT, between_s=between_s)
    assert code == Exit.INTERRUPTED
    assert left_in(study.parent) == []


@pytest.mark.parametrize("wait_s", [0.0, 0.3])
def test_the_same_command_afterwards_completes_the_same_bytes(study: Path, whole: str, wait_s: float) -> None:
    """Of a run that has only begun; `test_run` interrupts later ones."""
    out = study.with_name("out.zarr")
    words = ("run", str(study), "-o", str(out))
    process = start("-m", "mcstudy", *words, folder=study.parent)
    wait_until_signals_are_caught(process)
    time.sleep(wait_s)
    assert ends(process, signal.SIGINT)[0] == Exit.INTERRUPTED
    assert main(words) == Exit.DONE
    assert tree_digest(out) == whole
    assert not list(study.parent.glob(".*"))  # nothing that was begun to be made


@pytest.mark.skipif(not Path("/proc").exists(), reason="processes are found in /proc")
@pytest.mark.parametrize(
    ("verb", "when"), [("run", "compiled"), ("run", "out.zarr.log/runs.jsonl"), ("plan", "compiled")]
)
def test_nobody_waits_for_the_compiler(study: Path, verb: str, when: str) -> None:
    """Neither before the cube is there nor after, and the processes that compile end too."""
    words = ["-o", str(study.with_name("out.zarr"))] if verb == "run" else []
    process = start("-m", "mcstudy", verb, str(study), *words, folder=study.parent, cold=True)
    while not ((study.parent / when).exists() and compilers(study.parent)):
        assert process.poll() is None, process.communicate()
        time.sleep(0.02)
    code, _ = ends(process, signal.SIGINT)
    assert code == (Exit.INTERRUPTED if verb == "run" else Exit.STOPPED)
    assert left_in(study.parent) == []
    while compilers(study.parent):
        time.sleep(0.05)


def compilers(folder: Path) -> list[str]:
    """Processes that compile into ``folder``."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            words, variables = ((process / name).read_bytes() for name in ("cmdline", "environ"))
            if b"mcstudy.fitting.compilers" in words and bytes(folder / "compiled") in variables:
                found.append(process.name)
    return found


COMMANDS = {
    **{verb: (verb, "nothing") for verb in ("plan", "status", "show", "performance", "verify", "figure")},
    "replay": ("replay", "nothing", "--realization", "0", "--start", "0", "--fmax", "1", "--amplitude", "1"),
    "report": ("report", "nothing", "-o", "page.html"),
    "simulate": ("simulate", "-o", "nothing.nc"),
    **{verb: (verb,) for verb in ("warm", "studies", "models", "help")},
    "completion": ("completion", "bash"),
    "fit": ("fit", "nothing"),
    "import": ("import", "nothing", "-o", "nothing.nc"),
    "study-from": ("study-from", "nothing", "-o", "nothing.toml"),
    "infer": ("infer", "nothing", "-o", "d"),
    "design": ("design", "nothing", "-o", "d"),
    "solve": ("solve", "nothing", "--target", "cv(Td1) <= 10%", "--over", "cycles"),
    "gap": ("gap", "diagnose", "nothing"),
    "gap compare": ("gap", "compare", "nothing"),
    "gap next": ("gap", "next", "nothing"),
    "gap challenge score": ("gap", "challenge", "score", "nothing", "--key", "k", "--answers", "a"),
    "run": ("run", "nothing"),
    "extend": ("extend", "nothing"),
    "gap challenge make": ("gap", "challenge", "make", "nothing", "--data", "d", "--key", "k"),
    "gap challenge answer": ("gap", "challenge", "answer", "nothing", "-o", "a"),
    "gap challenge run": ("gap", "challenge", "run", "nothing", "-o", "d"),
}
# `mcstudy ...` that never ends by itself.
ENDLESS = """
import sys, time
from mcstudy.cli import main
from mcstudy.cli.verbs import module
module(sys.argv[1]).main = lambda args: time.sleep(1000)
sys.exit(main())
"""
# What comes before such a command that hears a signal the moment its handler is in place.
AT_ONCE = """
import os, signal
install = signal.signal

def hears(sign, handler):
    old = install(sign, handler)
    if sign == {sign} and callable(handler):
        os.kill(os.getpid(), sign)
    return old

signal.signal = hears
"""
RESUMABLE = {"run", "extend", "infer", "design", "gap challenge make", "gap challenge answer", "gap challenge run"}


def test_every_verb_is_stopped_here() -> None:
    assert set(verbs()) == {words[0] for words in COMMANDS.values()}


@pytest.mark.parametrize("name", COMMANDS)
def test_every_verb_ends_with_one_line_and_says_whether_it_resumes(tmp_path: Path, name: str) -> None:
    process = start("-c", ENDLESS, *COMMANDS[name], folder=tmp_path)
    wait_until_signals_are_caught(process)
    code, said = ends(process, signal.SIGTERM)
    if name in RESUMABLE:
        assert code == Exit.INTERRUPTED
        assert said == "mcstudy: stopped; run the same command again to resume: mcstudy " + " ".join(COMMANDS[name])
    else:
        assert code == Exit.STOPPED
        assert said == "mcstudy: stopped"


@pytest.mark.parametrize("sign", SIGNALS)
def test_no_signal_is_lost_while_the_handlers_are_installed(tmp_path: Path, sign: signal.Signals) -> None:
    process = start("-c", AT_ONCE.replace("{sign}", str(int(sign))) + ENDLESS, "show", "nothing", folder=tmp_path)
    assert ends(process) == (Exit.STOPPED, "mcstudy: stopped")


@pytest.mark.parametrize(("work", "sign"), [*zip(["swallows", "native", "writes"], SIGNALS, strict=True)])
def test_no_code_can_lose_a_signal_and_no_half_written_file_stays(
    tmp_path: Path, work: str, sign: signal.Signals
) -> None:
    process = start("-c", PROGRAM.replace("{work}", work), "show", str(tmp_path / "file"), folder=tmp_path)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    assert ends(process, sign) == (Exit.STOPPED, "mcstudy: stopped")
    assert [p for p in tmp_path.rglob("*") if p.is_file()] == []


def test_what_nohup_ignores_stays_ignored(tmp_path: Path) -> None:
    program = "import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)\n" + PROGRAM.replace("{work}", "swallows")
    process = start("-c", program, "show", "nothing", folder=tmp_path)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    process.send_signal(signal.SIGHUP)
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(timeout=1)
    assert ends(process, signal.SIGTERM)[0] == Exit.STOPPED


def test_a_terminal_that_is_gone_is_no_reason_to_stay(study: Path) -> None:
    """Nobody reads what it says, and what it writes fails."""
    study.write_text(STUDY.replace("realizations = 40", "realizations = 4000"))
    out = study.with_name("out.zarr")
    process = start("-m", "mcstudy", "run", str(study), "-o", str(out), folder=study.parent)
    assert process.stdout is not None
    assert process.stderr is not None
    while not (out / "noisy" / "status").exists() or not list((out / "noisy" / "status").glob("c.*")):
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)
    process.stdout.close()
    process.stderr.close()
    process.send_signal(signal.SIGHUP)
    assert process.wait(timeout=HUNG_S) == Exit.INTERRUPTED
    assert left_in(study.parent) == []


def test_a_run_whose_output_has_no_reader_does_not_claim_to_be_done(study: Path) -> None:
    process = start("-m", "mcstudy", "run", str(study), "-o", str(study.with_name("out.zarr")), folder=study.parent)
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    process.stderr.close()
    assert process.wait(timeout=120) == Exit.INTERRUPTED
