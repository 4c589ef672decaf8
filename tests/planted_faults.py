"""Whether the tests find faults: ``python -m tests.planted_faults [WORD...]``.

Each of `FAULTS` is planted alone in a copy of the package, and the tests that should find it run there. A fault that
they do not find has survived; all such are named, and the command ends with 1. Words choose the faults that hold one of
them. Where a module or a test moved, the text is still found: it must stand exactly once in the whole package.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PARTS = ("mcstudy", "pipelines", "results_schema", "tests")
FILES = ("pyproject.toml", "README.md", "CONTRIBUTING.md", "CHANGELOG.md")
SOURCES = ("mcstudy", "pipelines/mcstudy_*")
"""Where faults are planted."""

ONE_FAILED = 1
"""Exit code of pytest when a test failed; others are faults of this list, such as a file that is not there."""


class Fault(NamedTuple):
    """A fault of one line: ``right`` is replaced by ``wrong``, which ``tests`` (below ``tests/``) should find."""

    what: str
    right: str
    wrong: str
    tests: str


FAULTS = (
    # stance
    Fault(
        "a delay whose derivative has the wrong sign",
        "force[row, delay] += -s * total",
        "force[row, delay] += s * total",
        "stance/test_response.py",
    ),
    Fault(
        "noise with a constant offset",
        "    draws[0] = 0.0\n",
        "    draws[0] *= 1.0\n",
        "stance/test_noise.py",
    ),
    Fault(
        "noise that rises with frequency",
        "(self.reference_hz / fp) ** self.exponent * low_pass",
        "(fp / self.reference_hz) ** self.exponent * low_pass",
        "stance/test_noise.py",
    ),
    Fault(
        "a stimulus that is one state ahead",
        "position = np.cumsum(velocity) - velocity",
        "position = np.cumsum(velocity)",
        "stance/test_stimulus.py",
    ),
    Fault(
        "moments of inertia about other points than the common centre of mass",
        "(p.gyration**2 + (p.height - height) ** 2)",
        "(p.gyration**2)",
        "stance/test_anthropometry.py",
    ),
    # files
    Fault(
        "a file that gets its name before it is on disk",
        "            file.flush()\n            sync(file.fileno())\n",
        "            file.flush()\n",
        "files/test_durable.py",
    ),
    Fault(
        "what was reported of another study taken for its own",
        'ours = event.get("fingerprint", begun) == fingerprint',
        "ours = True",
        "study/test_runlog.py",
    ),
    Fault(
        "text in UTF-16 read in the other byte order",
        '"utf-16-be" if raw[0:1] == b"\\0" else "utf-16-le"',
        '"utf-16-le" if raw[0:1] == b"\\0" else "utf-16-be"',
        "recordings/test_text_files.py",
    ),
    Fault(
        "a link that is followed",
        "(0 if follow else os.O_NOFOLLOW)",
        "0",
        "files/test_untrusted.py",
    ),
    # recordings
    Fault(
        "a gon of 180 to the half turn",
        '"gon": math.pi / 200',
        '"gon": math.pi / 180',
        "recordings/test_text_files.py",
    ),
    Fault(
        "phases in radians taken where the gain falls",
        "falls = gain.max(axis=-1) > FALLS * gain[..., -1]",
        "falls = gain.max(axis=-1) < FALLS * gain[..., -1]",
        "recordings/test_polar.py",
    ),
    Fault(
        "the last sample lost when stamps become regular",
        "int(stamps[-1] * rate_hz * (1 + 1e-12)) + 1)",
        "int(stamps[-1] * rate_hz * (1 + 1e-12)))",
        "recordings/test_clock.py",
    ),
    Fault(
        "hours and minutes swapped",
        "3600.0 * int(hours) + 60.0 * int(minutes)",
        "60.0 * int(hours) + 3600.0 * int(minutes)",
        "recordings/test_text_files.py",
    ),
    Fault(
        "two angles that are one",
        "if np.array_equal(trial.theta[:, 0], trial.theta[:, 1]):",
        "if np.array_equal(trial.theta[:, 0], trial.stimulus):",
        "recordings/test_recording.py",
    ),
    Fault(
        "matrices of MATLAB read by rows",
        'values.astype(float).reshape(shape, order="F")',
        'values.astype(float).reshape(shape, order="C")',
        "recordings/test_import.py recordings/test_import_steps.py",
    ),
    # spectra
    Fault(
        "the variance of a mean that falls too slowly",
        "/ (count**2)[:, None, None]",
        "/ count[:, None, None]",
        "spectra/test_bands.py",
    ),
    Fault(
        "a highest frequency that leaves out the point at it",
        "self.harmonic <= fmax * self.period_s + 0.5",
        "self.harmonic < fmax * self.period_s",
        "spectra/test_bands.py",
    ),
    Fault(
        "fewer repeats with less noise",
        "noise=self.noise.times(1 / total)",
        "noise=self.noise.times(total)",
        "spectra/test_lines.py",
    ),
    Fault(
        "degrees of freedom of one repeat too many",
        "fdtrc(2 * m, 2 * m * (self.repeats - 1), ratio)",
        "fdtrc(2 * m, 2 * m * self.repeats, ratio)",
        "spectra/test_lines.py",
    ),
    # fitting
    Fault(
        "a cost that grows with the number of angles",
        "np.sqrt(model.n_angles * data.shape[0])",
        "np.sqrt(data.shape[0])",
        "fitting/test_problem.py",
    ),
    Fault(
        "standard errors too large by the root of two",
        "(G.conj().T @ joint @ G).real / 2",
        "(G.conj().T @ joint @ G).real",
        "fitting/test_standard_errors.py",
    ),
    Fault(
        "starts outside the bounds",
        "return model.lower + (model.upper - model.lower) * unit",
        "return model.lower + model.upper * unit",
        "fitting/test_starts.py",
    ),
    # study
    Fault(
        "a chunk whose checksums are not compared",
        "return said is None or said == self._note(chunk, sums, environments_of(said))",
        "return True",
        "study/test_checksums.py",
    ),
    Fault(
        "a status on disk before the names of what it speaks of",
        "        _together(lambda name: sync_folder(self.path / name), first)\n",
        "",
        "study/test_power_cut.py",
    ),
    Fault(
        "starts that share their random numbers with the noise",
        'return stream(seed, "start", realization)',
        'return stream(seed, "noise", realization)',
        "invariants/test_streams.py",
    ),
    Fault(
        "an estimate outside the bounds that is not noticed",
        "((estimate >= model.lower) & (estimate <= model.upper)).all()",
        "(estimate <= model.upper).all()",
        "study/test_verify.py study/test_ranges.py",
    ),
    # scheduler
    Fault(
        "a speed that counts what was done before",
        "return (done - before) / (now - begun) if now > begun else 0.0",
        "return done / (now - begun) if now > begun else 0.0",
        "scheduler/test_progress.py",
    ),
    # analysis
    Fault(
        "a jackknife without its factor",
        "np.sqrt(self.squares * (self.n - 1) / self.n.where(self.n > 1))",
        "np.sqrt(self.squares / self.n.where(self.n > 1))",
        "analysis/test_montecarlo.py",
    ),
    Fault(
        "one start too few",
        "np.maximum(np.ceil(exact / _EQUAL), 1.0)",
        "np.maximum(np.floor(exact / _EQUAL), 1.0)",
        "analysis/test_convergence.py",
    ),
    Fault(
        "deviations from the mean instead of the median",
        "np.median(np.abs(x - np.median(x, axis=1)[:, None]), axis=1)",
        "np.median(np.abs(x - np.mean(x, axis=1)[:, None]), axis=1)",
        "analysis/test_robust.py",
    ),
    Fault(
        "a paper's number taken without its rounding",
        "return abs(gap) - paper.half_unit, paper.margin - abs(gap)",
        "return abs(gap), paper.margin - abs(gap)",
        "analysis/test_verdict.py",
    ),
    Fault(
        "realizations in proportion to the error, not to its square",
        "asked = MARGIN * n * (found.mcse / target.percent) ** 2",
        "asked = MARGIN * n * (found.mcse / target.percent)",
        "adaptive/test_adaptive.py",
    ),
    # gap
    Fault(
        "prior probabilities that do not add up to one",
        "np.array([SINGLE, PAIR, UNKNOWN, BESIDE]) * ((1 - none) / (1 - NONE))",
        "np.array([SINGLE, PAIR, UNKNOWN, BESIDE])",
        "gap/test_words.py gap/test_diagnose.py gap/test_posterior.py",
    ),
    Fault(
        "p-values of contrasts that are not shared out",
        "share = CONTRAST_SHARE / max(1, len(own))",
        "share = CONTRAST_SHARE",
        "gap/test_any_gap.py",
    ),
    # identification, group comparison
    Fault(
        "degrees of freedom of one person too many",
        "v[0] ** 2 / (a.n - 1) + v[1] ** 2 / (b.n - 1)",
        "v[0] ** 2 / a.n + v[1] ** 2 / b.n",
        "identification/test_population.py",
    ),
    Fault(
        "the smallest p-value of all sets instead of the largest",
        "single[list(some)] = np.maximum(single[list(some)], p)",
        "single[list(some)] = p",
        "group_comparison/test_detection.py group_comparison/test_compare.py",
    ),
    # planning, stimulus design, effects, words
    Fault(
        "contributions to an error that are too small",
        "/ np.sqrt(n * (n - 1))",
        "/ n**1.5",
        "planning/test_multilevel.py",
    ),
    Fault(
        "a gradient of a criterion that is not its own",
        "slope = ZV @ V.ravel() / t",
        "slope = -ZV @ V.ravel() / t",
        "stimulus_design/test_optimum.py",
    ),
    Fault(
        "two filters in series whose powers are not added",
        "powers[name] = powers.get(name, 0) + power",
        "powers[name] = power",
        "effect_library/test_library.py effect_library/test_simulate.py",
    ),
    Fault(
        "an exit code of another meaning",
        'DIFFERS = 6, "stored',
        'DIFFERS = 4, "stored',
        "cli/test_exits.py",
    ),
)


def place(folder: Path, right: str) -> Path:
    """The file that holds a text, which stands once in all sources; `ValueError` otherwise."""
    files = [file for part in SOURCES for top in sorted(folder.glob(part)) for file in sorted(top.rglob("*.py"))]
    found = [file for file in files for _ in range(file.read_text(encoding="utf-8").count(right))]
    if len(found) != 1:
        raise ValueError(f"expected once, found {len(found)} times: {right!r}")
    return found[0]


def survives(folder: Path, fault: Fault) -> bool:
    """Whether the tests of a fault pass with it; the copy in ``folder`` is as before afterwards."""
    file = place(folder, fault.right)
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace(fault.right, fault.wrong), encoding="utf-8")
    for compiled in (file.parent / "__pycache__").glob(f"{file.stem}.*.pyc"):
        compiled.unlink()
    path = os.pathsep.join(str(p) for p in (folder, folder / "pipelines"))
    tests = [str(folder / "tests" / name) for name in fault.tests.split()]
    try:
        done = subprocess.run(
            [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests],
            cwd=folder,
            env=os.environ | {"PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"},
            capture_output=True,
            text=True,
            check=False,
        )
    finally:
        file.write_text(text, encoding="utf-8")
    if done.returncode not in (0, ONE_FAILED):
        raise RuntimeError(f"{fault.what}: {fault.tests} cannot run\n{done.stdout}{done.stderr}")
    print(done.stdout.splitlines()[-1], end=" ", flush=True)
    return done.returncode == 0


def main(words: list[str]) -> int:
    """Plant the faults one by one; the number of those that survive, at most 1."""
    chosen = [f for f in FAULTS if not words or any(word in " ".join(f) for word in words)]
    alive = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for part in PARTS:
            shutil.copytree(ROOT / part, folder / part)  # with compiled modules, which are as old as their sources
        for part in FILES:
            shutil.copy2(ROOT / part, folder / part)
        for number, fault in enumerate(chosen, 1):
            print(f"{number}/{len(chosen)} {fault.what} ({fault.tests}):", end=" ", flush=True)
            alive += [fault] if survives(folder, fault) else []
            print("SURVIVED" if fault in alive else "found", flush=True)
    print(f"{len(chosen) - len(alive)} of {len(chosen)} faults found")
    return min(len(alive), 1)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
