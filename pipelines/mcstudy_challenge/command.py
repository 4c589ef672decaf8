"""``mcstudy gap challenge``: the benchmark of the diagnosis, a command of the command line of mcstudy."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from mcstudy.cli.options import (
    add_figure_argument,
    add_json_argument,
    add_out_argument,
    add_scheduler_arguments,
    cluster_options,
)
from mcstudy.cli.terminal import print_json
from mcstudy.exits import Exit

if TYPE_CHECKING:
    from mcstudy.cli.parser import Parser
    from mcstudy_challenge.design import ChallengeFile

HELP = "benchmark the diagnosis on recordings with hidden causes"
VERBS = {
    "make": "simulate recordings and write the answer key to a separate file",
    "answer": "diagnose every recording in a folder",
    "score": "score answers against the key",
    "run": "make, answer and score in one command; resumes where it was stopped",
}
"""Verbs of the command, and their one-line help."""

RESUMABLE = ("make", "answer", "run")
SHIPPED = {"make file": "challenge", "run file": "challenge"}


def add_arguments(parser: Parser) -> None:
    """Arguments of the command and of its verbs."""
    make, answer, score, run = parser.add_verbs("challenge", VERBS)
    make.add_argument("file", type=Path, help="challenge file (.toml), or the name of a shipped one (gap_challenge)")
    make.add_argument("--data", type=Path, required=True, metavar="DIR", help="folder for the recordings")
    make.add_argument("--key", type=Path, required=True, metavar="FILE", help="answer key to write, outside DIR")
    make.set_defaults(run=_make)

    answer.add_argument("data", type=Path, help="folder of the recordings; must not contain the key")
    add_out_argument(answer, "FILE", "answers to write (JSON)", required=True)
    answer.add_argument(
        "--method",
        choices=("fast", "bootstrap", "detect"),
        default="fast",
        help="statistics of the diagnosis (default fast); detect tests for a mismatch without naming causes",
    )
    answer.set_defaults(run=_answer)

    score.add_argument("data", type=Path, help="folder of the recordings")
    score.add_argument("--key", type=Path, required=True, metavar="FILE", help="answer key (JSON)")
    score.add_argument("--answers", type=Path, required=True, metavar="FILE", help="answers (JSON)")
    add_out_argument(score, "FILE", "also write the score (JSON)")
    add_json_argument(score)
    add_figure_argument(score, "the reliability of stated probabilities")
    score.add_argument(
        "--share-none",
        nargs="+",
        type=float,
        metavar="P",
        help="weight the cases as if this share of them lacked nothing (default 0.1 0.3 0.5)",
    )
    score.set_defaults(run=_score)

    run.add_argument("file", type=Path, help="challenge file (.toml), or the name of a shipped one (gap_challenge)")
    add_out_argument(run, "DIR", "folder for all results", required=True)
    run.set_defaults(run=_run)
    for verb in (make, answer, run):
        add_scheduler_arguments(verb)
    for verb in (score, run):
        verb.add_argument(
            "--check", action="store_true", help="exit with code 5 when a target is missed at the 99.9 %% level"
        )


def main(args: argparse.Namespace) -> Exit:
    """Run the verb; returns the exit code."""
    code: Exit = args.run(args)
    return code


def _made(args: argparse.Namespace, data: Path, key: Path) -> tuple[ChallengeFile, str]:
    """Make the challenge of a file; returns its design and the SHA-256 of its key."""
    from mcstudy.errors import DesignError
    from mcstudy.scheduler.compiling import RECORDING
    from mcstudy_challenge.challenge_file import read_challenge
    from mcstudy_challenge.make import make

    file = read_challenge(args.file)
    _compile(args, RECORDING)
    try:
        return file, make(file, data, key, cluster_options(args))
    except DesignError as error:
        raise DesignError(f"{args.file}: {error}") from None


def _compile(args: argparse.Namespace, parts: tuple[str, ...]) -> None:
    """Compile what the cases need before they are counted; other workers do so when they need it."""
    from mcstudy.scheduler.compiling import compile_kernels

    if args.scheduler is None and args.slurm is None:
        compile_kernels(parts)


def _make(args: argparse.Namespace) -> Exit:
    file, sha = _made(args, args.data, args.key)
    print(f"{args.data}: {file.total} recordings; key {args.key}, sha256 {sha}")
    return Exit.DONE


def _answer(args: argparse.Namespace) -> Exit:
    from mcstudy.scheduler.compiling import DIAGNOSIS
    from mcstudy_challenge.answer import METHODS, answer

    _compile(args, DIAGNOSIS)
    sha = answer(args.data, args.out, METHODS[args.method], args.method, cluster_options(args))
    print(f"{args.out}: sha256 {sha}")
    return Exit.DONE


def _score(args: argparse.Namespace) -> Exit:
    from mcstudy.cli.figure_file import check_figure, write_figure
    from mcstudy.errors import InputError
    from mcstudy.files.json_files import json_text, write_json
    from mcstudy.text_tables import folded
    from mcstudy_challenge.scores.other_shares import SHARES
    from mcstudy_challenge.scores.score import exit_code, score_files
    from mcstudy_challenge.scores.table import score_text

    shares = args.share_none or SHARES
    if not all(0 < p < 1 for p in shares):
        raise InputError(f"--share-none: expected shares above 0 and below 1, got {' '.join(map(str, shares))}")
    check_figure(args.figure)
    score = score_files(args.data, args.key, args.answers, shares)
    if args.out:
        write_json(args.out, score, "challenge_score")
    if args.figure:
        from mcstudy_challenge.scores.reliability import reliability_picture

        write_figure(reliability_picture(score), args.figure)
    if args.json:
        print_json(json_text(score, "challenge_score", "score"))
    else:
        print(folded(score_text(score)))
    return exit_code(score) if args.check else Exit.DONE


def _run(args: argparse.Namespace) -> Exit:
    from mcstudy.cli.figure_file import check_figure, write_figure
    from mcstudy.files.json_files import own_folder, write_json, write_text
    from mcstudy.scheduler.compiling import DIAGNOSIS
    from mcstudy.text_tables import folded, unfolded
    from mcstudy_challenge.answer import METHODS, answer, answered
    from mcstudy_challenge.scores.score import exit_code, score_files
    from mcstudy_challenge.scores.table import score_text

    own_folder(args.out, "data", "a challenge")
    data, key, answers = args.out / "data", args.out / "key.json", args.out / "answers.json"
    figure = args.out / "reliability.svg"
    check_figure(figure)
    from mcstudy_challenge.scores.reliability import reliability_picture

    file, _ = _made(args, data, key)
    if not answered(data, answers, file.answer.method):
        _compile(args, DIAGNOSIS)
        answer(data, answers, METHODS[file.answer.method], file.answer.method, cluster_options(args))
    score = score_files(data, key, answers)
    write_json(args.out / "score.json", score, "challenge_score")
    with unfolded():
        page = score_text(score)
    write_text(args.out / "score.txt", page)
    write_figure(reliability_picture(score), figure)
    print(folded(score_text(score)))
    return exit_code(score) if args.check else Exit.DONE
