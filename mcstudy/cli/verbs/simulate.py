"""``mcstudy simulate``: simulate a recording of a standing body, optionally with effects of the library."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING

from mcstudy.cli.options import add_out_argument
from mcstudy.exits import Exit

if TYPE_CHECKING:
    from mcstudy.cli.parser import Parser
    from mcstudy.stance.line_stimulus import Stimulus

TOPIC = "diagnosis"


def add_arguments(parser: Parser) -> None:
    """Declare the arguments."""
    add_out_argument(
        parser,
        "REC",
        "file to write: rec.nc, rec.zarr, or a name without extension for CSV",
        dest="output",
        required=True,
    )
    parser.add_argument(
        "--effect",
        action="append",
        default=[],
        metavar="NAME[=SIZE]",
        help="an effect listed by `mcstudy gap effects`, of size SIZE or drawn from its usual range (and reduced "
        "until the body is stable); may be repeated",
    )
    parser.add_argument(
        "--stimulus",
        default="ankle_torque",
        help="of two_segment: ankle_torque (default), hip_torque, platform_translation, surface_tilt or visual_tilt",
    )
    parser.add_argument(
        "--stimulus-of",
        metavar="STUDY[:GROUP]",
        help="take the stimulus of a study file (also the study.toml of `mcstudy design`): its kind, its sequence or "
        "its lines, rate, cycles, amplitudes and their convention; GROUP is the first one unless given",
    )
    parser.add_argument(
        "--amplitude",
        type=float,
        nargs="+",
        help="stimulus amplitude of each trial, N m, m or (tilt) rad (default: two trials of 5 N m); of a declared "
        "model in the unit of its stimulus (default: one trial of 1)",
    )
    parser.add_argument("--convention", default="peak", help="amplitudes are peak (default) or peak_to_peak values")
    parser.add_argument("--cycles", type=int, help="stimulus periods per trial (default 6)")
    parser.add_argument("--rate", type=float, default=200.0, help="sampling rate, Hz (default 200)")
    parser.add_argument("--aperiodic", action="store_true", help="use a random stimulus that never repeats")
    parser.add_argument(
        "--noise", type=float, default=1.0, help="amplitude of the sensor noise relative to the paper's (default 1)"
    )
    parser.add_argument(
        "--parameter",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="value of a model parameter instead of the nominal one; may be repeated",
    )
    parser.add_argument("--seed", type=int, default=0, help="random seed (default 0)")
    parser.add_argument(
        "--model",
        metavar="NAME|FILE",
        help="a declared model (`mcstudy models`, or a .toml) whose outputs are recorded (default two_segment)",
    )
    parser.add_argument(
        "--measurement-sd",
        type=float,
        nargs="+",
        default=[0.0],
        metavar="SD",
        help="standard deviation of white noise on every sample of what is recorded, outside the loop: one number, or "
        "one for each output, in its unit (deg where that is rad; default 0)",
    )


def main(args: argparse.Namespace) -> Exit:
    """Simulate and write; returns the exit code."""
    from mcstudy.effect_library.simulation import simulate
    from mcstudy.errors import InputError
    from mcstudy.recordings.io import write_recording
    from mcstudy.scheduler.compiling import RECORDING, compile_kernels

    sizes = {w.split("=")[0]: _pair(w, "--effect")[1] if "=" in w else None for w in args.effect}
    if len(sizes) < len(args.effect):
        raise InputError(f"--effect: expected each effect once, got {' '.join(args.effect)}")
    kind, waveform, amplitudes, cycles = args.stimulus, None, None, 6
    if args.stimulus_of:
        kind, waveform, amplitudes, cycles = _stimulus_of(args)
    compile_kernels(RECORDING)
    try:
        recording = simulate(
            sizes,
            stimulus=kind,
            waveform=waveform,
            amplitude=args.amplitude or amplitudes,
            convention=args.convention,
            cycles=cycles if args.cycles is None else args.cycles,
            rate_hz=args.rate,
            periodic=not args.aperiodic,
            noise=args.noise,
            parameters=dict(_pair(p, "--parameter") for p in args.parameter),
            seed=args.seed,
            name=Path(args.output).stem,
            model=args.model,
            measurement_sd=args.measurement_sd[0] if len(args.measurement_sd) == 1 else args.measurement_sd,
        )
    except InputError as error:
        raise type(error)(_OPTION.sub(lambda m: f"--{m[1].replace('_', '-')}", str(error), count=1)) from None
    path = write_recording(recording, args.output)
    what = recording.provenance.removeprefix("simulated by mcstudy: ").rpartition("; seed")[0]
    print(f"{path}: {len(recording.trials)} trials of {recording.duration_s / len(recording.trials):.0f} s; {what}")
    return Exit.DONE


def _stimulus_of(args: argparse.Namespace) -> tuple[str, Stimulus, list[float] | None, int]:
    """Kind, waveform, amplitudes and cycles of the stimulus of a group of a study file."""
    from mcstudy.errors import InputError
    from mcstudy.study.measure import stimulus
    from mcstudy.study.study_file import read_study

    for option, given in (
        ("--stimulus", args.stimulus != "ankle_torque"),
        ("--rate", args.rate != 200.0),
        ("--convention", args.convention != "peak"),
    ):
        if given:
            raise InputError(f"{option}: expected none beside --stimulus-of, which states it")
    file, _, name = args.stimulus_of.partition(":")
    groups = read_study(file).groups
    if name and name not in groups:
        raise InputError(f"--stimulus-of {args.stimulus_of}: expected a group of {', '.join(groups)}, got {name!r}")
    group = groups[name or next(iter(groups))]
    if group.model.declared and args.model is None:
        raise InputError(f"--stimulus-of {args.stimulus_of}: expected --model beside a study of a declared model")
    own = group.stimulus
    return (
        args.stimulus if args.model else own.kind,
        stimulus(group, group.amplitude[0]),
        list(group.amplitude),
        own.cycles,
    )


_OPTION = re.compile(r"^(amplitude|noise|cycles|seed|stimulus|parameter|effect|rate|measurement_sd)(?:s|_hz)?(?=[: ])")
"""The argument that a message starts with, which is an option here."""


def _pair(word: str, option: str) -> tuple[str, float]:
    from mcstudy.errors import InputError

    name, _, text = word.partition("=")
    try:
        return name, float(text)
    except ValueError:
        raise InputError(f"{option} {word}: expected NAME=NUMBER") from None
