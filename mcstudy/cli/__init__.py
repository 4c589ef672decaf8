"""The command line: one module per verb in `verbs`, imported only when it is used, so that help appears at once."""

from __future__ import annotations

import contextlib
import os
import sys

TYPE_CHECKING = False  # as in `mcstudy`: nothing is imported before signals are caught
if TYPE_CHECKING:
    from collections.abc import Sequence

    from mcstudy.cli.stop import Stop
    from mcstudy.exits import Exit

ONE_THREAD = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
"""Variables that are set to 1 unless the user has set them."""


def main(arguments: Sequence[str] | None = None) -> Exit:
    """Entry point; returns the exit code.

    Without ``arguments`` it acts as the command: it reads the arguments of the process and handles its signals. With
    ``arguments`` it is an ordinary function and does not touch the process.
    """
    if arguments is not None:
        return _main(list(arguments), None)
    import gc

    from mcstudy.cli.stop import catch
    from mcstudy.cli.terminal import replace_what_cannot_be_shown

    # A look is mostly imports, which make 170,000 objects that stay. To search them for garbage after every 700 new
    # ones takes a twelfth of the imports' time (pipelines/benchmarks/README.md). Others' processes stay as they are.
    gc.set_threshold(300_000)
    stop, words = catch(), sys.argv[1:]
    replace_what_cannot_be_shown()
    stop.watch(words)
    code = _main(words, stop)
    # An interpreter that ends searches all objects for garbage twice more: a quarter of the imports' time.
    gc.freeze()
    return code


def _main(words: list[str], stop: Stop | None) -> Exit:
    """The same; one line where a disk does not take what is written, the output among it."""
    import errno

    from mcstudy.cli.terminal import drop_output
    from mcstudy.exits import Exit

    try:
        try:
            return _done(words, stop)
        finally:
            if sys.stdout is not None:
                sys.stdout.flush()
    except BrokenPipeError:
        drop_output()
        return Exit.DONE  # the reader (head, less) has seen enough
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EROFS, errno.EFBIG):
            raise
        drop_output()
        _tell(f"{error.filename or 'output'}: cannot be written: {error.strerror}")
        return Exit.BAD_INPUT


def _done(words: list[str], stop: Stop | None) -> Exit:
    from mcstudy.cli.parser import main_parser
    from mcstudy.cli.verbs import SHORT, is_verb, listed
    from mcstudy.exits import Exit

    if words[:1] and is_verb(words[0]):
        return _run(words[0], words[1:], stop)
    if words[:1] and words[0] in SHORT:
        return _run("gap", words, stop)
    if words[:1] and not words[0].startswith("-"):
        from mcstudy.text_tables import similar

        _tell(f"{words[0]}: expected a verb{similar(words[0], listed())}; mcstudy --help lists them")
        return Exit.BAD_INPUT
    parser = main_parser()
    args = parser.parse_args(words)
    if args.version:
        from mcstudy import __version__

        print(f"mcstudy {__version__}")
        return Exit.DONE
    parser.print_help()
    return Exit.DONE if not words else Exit.BAD_INPUT


def _run(verb: str, words: Sequence[str], stop: Stop | None) -> Exit:
    # One thread for linear algebra, set before numpy is imported. Fits run in parallel instead. Sums that are split
    # differently on another machine would differ in the last digits.
    for variable in ONE_THREAD:
        os.environ.setdefault(variable, "1")
    from mcstudy.cli.parser import parser_of
    from mcstudy.cli.stop import stopped, unusable, with_command
    from mcstudy.cli.terminal import drop_output
    from mcstudy.cli.verbs import module
    from mcstudy.errors import InputError, Interrupted, Stopped
    from mcstudy.exits import Exit

    try:
        parser = parser_of(verb)
        args = parser.parse_args(_local(words))
        args.parser = parser  # a page shows the command that makes it
        code: Exit = module(verb).main(args)
        return code
    except InputError as error:
        _tell(_one_line(error))
        return Exit.BAD_INPUT
    except Stopped as error:
        message, code = _one_line(error), Exit.STOPPED
    except Interrupted as error:
        message, code = with_command(_one_line(error), [verb, *words]), Exit.INTERRUPTED
    except KeyboardInterrupt:
        message, code = stopped([verb, *words])
    except BrokenPipeError:
        drop_output()
        message, code = stopped([verb, *words], " (nothing reads its output)")
        if code is not Exit.INTERRUPTED and (stop is None or not stop.asked):
            return Exit.DONE  # the reader (head, less) has seen enough
    except Exception as error:
        if stop is None or not stop.asked:
            known = unusable(error, [verb, *words])
            if known is None:
                raise
            message, code = known
            _tell(message)
            return code
        # Libraries raise this when they are stopped halfway, or when they print to a terminal that is gone.
        message, code = stopped([verb, *words], f" ({type(error).__name__}: {_one_line(error)})")
    with contextlib.suppress(OSError):
        sys.stdout.flush()
    if stop is not None:
        stop.leave(message, code)  # do not wait for threads that are still computing
    _tell(message)
    return code


def _local(words: Sequence[str]) -> list[str]:
    """The words with ``file://`` addresses as paths; `InputError` for other addresses, except that of a scheduler."""
    from mcstudy.files.local_path import ADDRESS, local_path

    out: list[str] = []
    for word in words:
        option, equals, value = word.partition("=") if word.startswith("--") else ("", "", word)
        asked = option if equals else (out or [""])[-1]
        if "://" in value and not (len(asked) > len("--s") and "--scheduler".startswith(asked)):
            value = str(local_path(value)) if ADDRESS.match(value) else value
        out.append(option + equals + value)
    return out


def _tell(message: str) -> None:
    """One line for the person; without a reader, or on a full disk, the exit code alone tells."""
    with contextlib.suppress(OSError):
        print(f"mcstudy: {message}", file=sys.stderr, flush=True)


def _one_line(error: BaseException) -> str:
    from mcstudy.text_tables import printable

    return printable(str(error))
