"""Arguments shared by verbs, each in one form, and what they mean."""

from __future__ import annotations

import argparse
import contextlib
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mcstudy.api.where import Where
    from mcstudy.cli.parser import Group, Parser
    from mcstudy.scheduler.cluster import ClusterOptions
    from mcstudy.study.design import Study


def add_cube_argument(parser: Parser) -> None:
    """The cube that a verb is about."""
    parser.add_argument("out", type=Path, help="results cube")


def add_study_argument(parser: Parser) -> None:
    """The study that a verb is about."""
    parser.add_argument("study", type=Path, help="study file (.toml), or the name of a shipped study (mcstudy studies)")


def add_other_model_argument(parser: Parser, of: str) -> None:
    """A model instead of the one that a file names."""
    parser.add_argument(
        "--model", metavar="NAME|FILE", help=f"a model (`mcstudy models`, or a .toml) instead of that of {of}"
    )


def add_out_argument(parser: Parser, metavar: str, text: str, *, dest: str = "out", required: bool = False) -> None:
    """What a verb writes."""
    names = ("-o", "--out", "--output")
    parser.add_argument(*names, dest=dest, type=Path, required=required, metavar=metavar, help=text)


def add_json_argument(parser: Parser | Group, text: str = "print JSON (described in results_schema)") -> None:
    """Output for programs."""
    parser.add_argument("--json", action="store_true", help=text)


def add_page_argument(parser: Parser, text: str = "also write a self-contained page with all figures") -> None:
    """A page that a verb writes besides."""
    parser.add_argument("--html", type=Path, metavar="PAGE", help=text)


def add_figure_argument(parser: Parser, what: str, option: str = "--figure") -> None:
    """A figure that a verb draws besides."""
    parser.add_argument(option, type=Path, metavar="FILE", help=f"also draw {what} (.svg, .png or .pdf)")


def add_scheduler_arguments(parser: Parser | Group) -> None:
    """Arguments that choose where to run."""
    parser.add_argument("--workers", type=positive, help="threads of the local scheduler; default one per core")
    parser.add_argument(
        "--scheduler", metavar="ADDR", help="use a running Dask scheduler: tls://HOST:PORT or tcp://HOST:PORT"
    )
    parser.add_argument("--tls-ca", type=Path, metavar="PEM", help="certificate authority of a tls:// scheduler")
    parser.add_argument("--tls-cert", type=Path, metavar="PEM", help="client certificate for a tls:// scheduler")
    parser.add_argument("--tls-key", type=Path, metavar="PEM", help="key of the client certificate")
    parser.add_argument(
        "--insecure",
        action="store_true",
        help="accept an unencrypted tcp:// scheduler on another machine",
    )
    parser.add_argument(
        "--slurm", type=Path, metavar="FILE", help="submit the workers as jobs of a Slurm cluster, as FILE (.toml) says"
    )
    parser.add_argument("--dashboard", action="store_true", help="serve Dask's dashboard on 127.0.0.1:8787")


def add_cluster_arguments(parser: Parser) -> None:
    """Arguments that choose where to run, how large a block is and how long it may take."""
    add_scheduler_arguments(parser)
    parser.add_argument("--block", type=positive, help="chunks per task; default about 0.5 s of work")
    parser.add_argument(
        "--block-timeout",
        type=seconds,
        metavar="SECONDS",
        help="time limit per task (block), after which its worker is restarted; default no limit",
    )


def add_unstable_argument(parser: Parser) -> None:
    """Argument that allows unstable bodies."""
    parser.add_argument(
        "--allow-unstable",
        action="store_true",
        help="accept true parameters with an unstable closed loop (no steady state exists)",
    )


def stable_study(args: argparse.Namespace) -> Study:
    """The study in the file ``args.study``; raises `DesignError` (one line) if it is invalid or its body unstable."""
    from mcstudy.errors import DesignError
    from mcstudy.study.study_file import read_study

    study = read_study(args.study, getattr(args, "model", None))
    from mcstudy.study.instability import refuse_unstable
    from mcstudy.study.kernels import compile_for_check  # numba is slow to import; report a bad file first

    compile_for_check(study, fits=getattr(args, "scheduler", None) is None and getattr(args, "slurm", None) is None)
    try:
        refuse_unstable(study, args.allow_unstable)
    except DesignError as error:
        raise DesignError(f"{args.study}: {error}") from None
    return study


def cluster_options(args: argparse.Namespace) -> ClusterOptions:
    """What `add_scheduler_arguments` or `add_cluster_arguments` declared."""
    from mcstudy.api.where import cluster_options

    return cluster_options(where(args))


def where(args: argparse.Namespace) -> Where:
    """The same as the functions of `mcstudy` take it."""
    from mcstudy.api.where import Where

    return Where(**{name: getattr(args, name) for name in Where.__annotations__ if hasattr(args, name)})  # type: ignore[typeddict-item]


def shown_command(args: argparse.Namespace) -> str:
    """The command as the page that it writes displays it: without other outputs."""
    return shlex.join(args.parser.command(args, without=("out", "json", "figure")))


@contextlib.contextmanager
def named_as_options(**options: str) -> Iterator[None]:
    """Errors about an argument of a function name the option that states it: argument = option."""
    from mcstudy.errors import InputError

    try:
        yield
    except InputError as error:
        arguments, colon, rest = str(error).partition(": ")
        names = [options.get(name) for name in arguments.split(", ")]
        if None in names:
            raise
        raise type(error)(f"{', '.join(f'--{name}' for name in names)}{colon}{rest}") from None


def positive(text: str) -> int:
    """A whole number from 1, as argparse's ``type``."""
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"expected a whole number from 1, got {text}")
    return value


def relative(text: str) -> float:
    """A relative difference, above 0 and below 1, as argparse's ``type``."""
    value = float(text)
    if not 0 < value < 1:
        raise argparse.ArgumentTypeError(f"expected a number above 0 and below 1, such as 1e-6, got {text}")
    return value


def seconds(text: str) -> float:
    """A time above 0, as argparse's ``type``."""
    value = float(text)
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"expected seconds above 0, got {text}")
    return value


def names(given: str) -> tuple[str, ...]:
    """Names between commas."""
    return tuple(name.strip() for name in given.split(","))


def numbers(given: str) -> tuple[float, ...]:
    """Numbers between commas; raises `ValueError`, which argparse reports."""
    return tuple(map(float, names(given)))
