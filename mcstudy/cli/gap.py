"""``mcstudy gap``: where a model fails on a recording, which effect is missing, how far adding it closes the gap."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from mcstudy.cli.options import add_scheduler_arguments, cluster_options
from mcstudy.exits import Exit

if TYPE_CHECKING:
    from mcstudy.gap.challenge.design import ChallengeFile
    from mcstudy.gap.diagnosis import Diagnosis
    from mcstudy.gap.frf_only import FrfRecording
    from mcstudy.gap.recording import Recording


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb and of the verbs below it."""
    verbs = parser.add_subparsers(dest="gap", metavar="VERB", required=True)
    effects = verbs.add_parser("effects", help="list the effects a model may lack, with equation and published size")
    effects.set_defaults(run=_effects)

    diagnose = verbs.add_parser("diagnose", help="diagnose recordings of one body")
    diagnose.add_argument("-o", "--out", type=Path, metavar="DIR", help="also write diagnosis.json and diagnosis.txt")
    diagnose.add_argument("--json", action="store_true", help="print JSON, as results_schema describes")
    diagnose.set_defaults(run=_diagnose)

    report = verbs.add_parser("report", help="diagnose recordings of one body and write it as one page with figures")
    report.add_argument("-o", "--output", type=Path, required=True, metavar="PAGE", help="the page to write (.html)")
    report.set_defaults(run=_report)
    for verb in (diagnose, report):
        verb.add_argument("recordings", nargs="+", type=Path, metavar="REC", help=".nc, .zarr, .toml, or .csv")
        verb.add_argument("--fast", action="store_true", help="asymptotic statistics in place of the bootstrap")
        verb.add_argument("--bootstrap", type=int, metavar="N", help="draws of the bootstrap (default 1000)")
        verb.add_argument("--seed", type=int, default=0, help="of every random number (default 0)")
        verb.add_argument("--fmax", type=float, default=8.0, metavar="HZ", help="highest frequency (default 8)")
        verb.add_argument(
            "--discard", type=int, default=1, metavar="N", help="cycles left out of every trial (default 1)"
        )
        verb.add_argument("--data", type=Path, metavar="DIR", help="where a .toml finds its files (default: beside it)")
        verb.add_argument("--accept", action="append", default=[], metavar="CODE", help="keep a suspicious labelling")

    challenge = verbs.add_parser("challenge", help="the benchmark on withheld causes")
    _challenge_arguments(challenge)


def _challenge_arguments(challenge: argparse.ArgumentParser) -> None:
    verbs = challenge.add_subparsers(dest="challenge", metavar="VERB", required=True)
    make = verbs.add_parser("make", help="make recordings and, apart from them, the key")
    make.add_argument("file", type=Path, help="challenge file (TOML)")
    make.add_argument("--data", type=Path, required=True, metavar="DIR", help="folder for the recordings")
    make.add_argument("--key", type=Path, required=True, metavar="FILE", help="the key, outside DIR")
    make.set_defaults(run=_make)

    answer = verbs.add_parser("answer", help="diagnose every recording of a data folder")
    answer.add_argument("data", type=Path, help="folder of the recordings; must not hold the key")
    answer.add_argument("-o", "--out", type=Path, required=True, metavar="FILE", help="answers (JSON)")
    answer.add_argument(
        "--method",
        choices=("fast", "bootstrap", "detect"),
        default="fast",
        help="statistics of the diagnosis; detect: no causes",
    )
    answer.set_defaults(run=_answer)

    score = verbs.add_parser("score", help="open the key and score answers")
    score.add_argument("data", type=Path, help="folder of the recordings")
    score.add_argument("--key", type=Path, required=True, metavar="FILE")
    score.add_argument("--answers", type=Path, required=True, metavar="FILE")
    score.add_argument("-o", "--out", type=Path, metavar="FILE", help="also write the score (JSON)")
    score.add_argument("--json", action="store_true", help="print JSON, as results_schema describes")
    score.set_defaults(run=_score)

    run = verbs.add_parser("run", help="make, answer and score with one command; resumes where it was stopped")
    run.add_argument("file", type=Path, help="challenge file (TOML)")
    run.add_argument("-o", "--out", type=Path, required=True, metavar="DIR")
    run.set_defaults(run=_run)
    for verb in (make, answer, run):
        add_scheduler_arguments(verb)
    for verb in (score, run):
        verb.add_argument(
            "--check", action="store_true", help="exit with 5 when a target is missed beyond doubt (99.9 %% interval)"
        )


def main(args: argparse.Namespace) -> Exit:
    """Run the verb below; returns the exit code."""
    code: Exit = args.run(args)
    return code


def _effects(_: argparse.Namespace) -> Exit:
    from mcstudy.gap.effects import table_text

    print(table_text())
    return Exit.DONE


def _diagnosed(args: argparse.Namespace) -> tuple[Diagnosis, Recording | FrfRecording | list[Recording]]:
    """The diagnosis, and the recording or recordings it is of."""
    from mcstudy.errors import InputError, RecordingError
    from mcstudy.gap.diagnose import diagnose, diagnose_fast
    from mcstudy.gap.read import read_recording
    from mcstudy.gap.recording import Recording

    if args.fast and args.bootstrap is not None:
        raise InputError("--bootstrap: expected without --fast, which does not use it")
    options = {"seed": args.seed, "fmax": args.fmax, "discard": args.discard, "accept": args.accept}
    if args.bootstrap is not None:
        options["bootstrap"] = args.bootstrap
    run = diagnose_fast if args.fast else diagnose
    read = [read_recording(path, data=args.data, accept=args.accept) for path in args.recordings]
    if len(read) == 1:
        return run(read[0], **options), read[0]
    several = []
    for path, one in zip(args.recordings, read, strict=True):
        if not isinstance(one, Recording):
            raise RecordingError(f"{path}: expected a recording with trials beside others, got an FRF")
        several.append(one)
    return run(several, **options), several


def _diagnose(args: argparse.Namespace) -> Exit:
    from mcstudy.gap.challenge.files import json_text, write_json, write_text
    from mcstudy.gap.tables import text

    diagnosis, _ = _diagnosed(args)
    words = f"{diagnosis.verdict()}\n\n{text(diagnosis)}"
    if args.out:
        write_json(args.out / "diagnosis.json", diagnosis.to_dict(), "diagnosis")
        write_text(args.out / "diagnosis.txt", words)
    print(json_text(diagnosis.to_dict(), "diagnosis", "diagnosis") if args.json else words)
    return Exit.DONE


def _report(args: argparse.Namespace) -> Exit:
    import shlex

    from mcstudy.cli.report import write_page
    from mcstudy.report.style import require_matplotlib

    require_matplotlib()

    def text() -> str:
        from mcstudy.report.gap_page import gap_page

        diagnosis, recording = _diagnosed(args)
        options = [*("--fast" for _ in range(args.fast)), *(w for code in args.accept for w in ("--accept", code))]
        for name, default in (("bootstrap", None), ("seed", 0), ("fmax", 8.0), ("discard", 1), ("data", None)):
            if getattr(args, name) != default:
                options += [f"--{name}", str(getattr(args, name))]
        command = ["mcstudy", "gap", "report", *map(str, args.recordings), *options, "-o", str(args.output)]
        return gap_page(diagnosis, recording, command=shlex.join(command))

    return write_page(args.output, text)


def _made(args: argparse.Namespace, data: Path, key: Path) -> tuple[ChallengeFile, str]:
    """The challenge of a file, made, and the SHA-256 of its key."""
    from mcstudy.errors import DesignError
    from mcstudy.gap.challenge.challenge_file import read_challenge
    from mcstudy.gap.challenge.make import make

    file = read_challenge(args.file)
    try:
        return file, make(file, data, key, cluster_options(args))
    except DesignError as error:
        raise DesignError(f"{args.file}: {error}") from None


def _make(args: argparse.Namespace) -> Exit:
    file, sha = _made(args, args.data, args.key)
    print(f"{args.data}: {file.total} recordings; key {args.key}, sha256 {sha}")
    return Exit.DONE


def _answer(args: argparse.Namespace) -> Exit:
    from mcstudy.gap.challenge.answer import METHODS, answer

    options = cluster_options(args)
    sha = answer(args.data, args.out, METHODS[args.method], args.method, options)
    print(f"{args.out}: sha256 {sha}")
    return Exit.DONE


def _score(args: argparse.Namespace) -> Exit:
    from mcstudy.gap.challenge.files import json_text, write_json
    from mcstudy.gap.challenge.score import exit_code, score_files
    from mcstudy.gap.challenge.table import text

    score = score_files(args.data, args.key, args.answers)
    if args.out:
        write_json(args.out, score, "challenge_score")
    print(json_text(score, "challenge_score", "score") if args.json else text(score))
    return exit_code(score) if args.check else Exit.DONE


def _run(args: argparse.Namespace) -> Exit:
    from mcstudy.gap.challenge.answer import METHODS, answer
    from mcstudy.gap.challenge.files import write_json, write_text
    from mcstudy.gap.challenge.score import exit_code, score_files
    from mcstudy.gap.challenge.table import text

    data, key, answers = args.out / "data", args.out / "key.json", args.out / "answers.json"
    file, _ = _made(args, data, key)
    if not answers.exists():
        answer(data, answers, METHODS[file.answer.method], file.answer.method, cluster_options(args))
    score = score_files(data, key, answers)
    write_json(args.out / "score.json", score, "challenge_score")
    page = text(score)
    write_text(args.out / "score.txt", page)
    print(page)
    return exit_code(score) if args.check else Exit.DONE
