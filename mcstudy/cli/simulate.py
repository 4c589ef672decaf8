"""``mcstudy simulate``: a recording of a simulated body, with any effects of the library."""

from __future__ import annotations

import argparse

from mcstudy.exits import Exit

SMALLER = 20
"""How often sizes that were drawn are made smaller by a quarter for a body that falls."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("-o", "--output", required=True, help="rec.nc, rec.zarr, or a name without ending for CSV")
    parser.add_argument(
        "--effect",
        action="append",
        default=[],
        metavar="NAME[=SIZE]",
        help="an effect of `mcstudy gap effects`, at SIZE or drawn from its published range (made smaller until the "
        "body stands); may be repeated",
    )
    parser.add_argument("--stimulus", default="ankle_torque", help="ankle_torque, hip_torque or platform_translation")
    parser.add_argument(
        "--amplitude", type=float, nargs="+", default=[5.0, 5.0], help="per trial, N m or m (default: two of 5 N m)"
    )
    parser.add_argument("--convention", default="peak", help="peak or peak_to_peak")
    parser.add_argument("--cycles", type=int, default=6, help="stimulus periods per trial")
    parser.add_argument("--rate", type=float, default=200.0, help="sampling rate, Hz")
    parser.add_argument("--aperiodic", action="store_true", help="a random stimulus that never repeats")
    parser.add_argument("--noise", type=float, default=1.0, help="sensor noise relative to the paper's (amplitude)")
    parser.add_argument(
        "--parameter", action="append", default=[], metavar="NAME=VALUE", help="another value than the nominal one"
    )
    parser.add_argument("--seed", type=int, default=0)


def main(args: argparse.Namespace) -> Exit:
    """Simulate and write; returns the exit code."""
    import numpy as np

    from mcstudy.errors import FallsError, InputError
    from mcstudy.gap.effects import effect
    from mcstudy.gap.make_recording import Protocol, draw_case, simulate_recording
    from mcstudy.gap.read import write_recording
    from mcstudy.stance.body import STIMULI, two_segment
    from mcstudy.stance.noise import SensorNoise
    from mcstudy.stance.ranges import Range
    from mcstudy.stance.stimulus import Prts
    from mcstudy.study.checks import DELAY, MAX_SAMPLES
    from mcstudy.study.group import AMPLITUDE, GAIN, RATE

    for amplitude in args.amplitude:
        AMPLITUDE.require(amplitude, "--amplitude")
    RATE.require(args.rate, "--rate")
    Range(1e-6, 1e6, or_zero=True).require(args.noise, "--noise")
    Range(1, 100_000).require(args.cycles, "--cycles")
    Range(0, 2**63 - 1).require(args.seed, "--seed")
    if args.stimulus not in STIMULI:
        raise InputError(f"--stimulus: expected one of {', '.join(STIMULI)}, got {args.stimulus!r}")
    psd = SensorNoise().psd_deg2_hz
    waveform = Prts(rate_hz=args.rate, amplitude=args.amplitude[0], convention=args.convention)
    if waveform.samples * args.cycles > MAX_SAMPLES:
        raise InputError(
            f"--cycles: expected a record of at most {MAX_SAMPLES} samples, got {args.cycles} cycles of "
            f"{waveform.samples}"
        )
    protocol = Protocol(
        stimulus=args.stimulus,
        waveform=waveform,
        amplitudes=tuple(args.amplitude),
        cycles=args.cycles,
        periodic=not args.aperiodic,
        noise=SensorNoise((psd[0] * args.noise**2, psd[1] * args.noise**2)),
    )
    model = two_segment(stimulus=args.stimulus)
    values = dict(_pair(p, "--parameter") for p in args.parameter)
    unknown = set(values) - set(model.names)
    if unknown:
        raise InputError(f"--parameter: unknown {', '.join(sorted(unknown))}; the model has {', '.join(model.names)}")
    for name, value in values.items():
        (DELAY if name in model.delays else GAIN).require(value, f"--parameter {name}")
    theta = np.array([values.get(p.name, p.value) for p in model.parameters])
    bounds = zip(model.names, theta, model.parameters, strict=True)
    nominal = model.with_bounds({n: (min(v, p.lower), max(v, p.upper)) for n, v, p in bounds})
    nominal = nominal.with_values(dict(zip(model.names, map(float, theta), strict=True)))
    names = [word.split("=")[0] for word in args.effect]
    given = {}
    for word in args.effect:
        if "=" in word:
            name, value = _pair(word, "--effect")
            size = effect(name).size
            given[size.name] = size.believable(value, f"--effect {name}")
    drawn = [word for word in args.effect if "=" not in word]
    for smaller in range(SMALLER):
        # From the beginning every time, so that what is drawn is the same and only smaller.
        drawing, running = np.random.default_rng(args.seed).spawn(2)
        sizes = dict(given)
        try:
            for name in drawn:
                sizes |= draw_case(nominal, [name], drawing, 0.75**smaller, spread=0.0, attempts=20)[1]
            what = ", ".join(f"{k} = {v:.5g}" for k, v in sizes.items()) or "no effect"
            recording = simulate_recording(
                protocol,
                theta,
                running,
                effects=names,
                sizes=sizes,
                provenance=f"simulated by mcstudy: {what}; seed {args.seed}",
            )
            break
        except FallsError:
            if not drawn:
                raise
    else:
        raise FallsError(
            f"--effect {', '.join(drawn)}: this body falls with every size that was tried; state one "
            f"(--effect {drawn[0]}=SIZE), or shorter delays (such as --parameter Td1=0.06 --parameter Td2=0.07)"
        )
    if smaller:
        what += (
            f" (drawn from {0.75**smaller:.2g} of the published range, as this body falls with more; "
            "shorter delays, such as --parameter Td1=0.06 --parameter Td2=0.07, may hold it)"
        )
    path = write_recording(recording, args.output)
    print(f"{path}: {len(recording.trials)} trials of {recording.duration_s / len(recording.trials):.0f} s; {what}")
    return Exit.DONE


def _pair(word: str, option: str) -> tuple[str, float]:
    from mcstudy.errors import InputError

    name, _, text = word.partition("=")
    try:
        return name, float(text)
    except ValueError:
        raise InputError(f"{option} {word}: expected NAME=NUMBER") from None
