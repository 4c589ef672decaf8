"""Recordings: parameters and diagnosis, from paths or in memory. Nothing here needs studies, or what runs them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from mcstudy.gap.diagnose import diagnose as diagnose_recordings
from mcstudy.gap.prior import NONE
from mcstudy.gap.settings import CAUSE_ONLY, DiagnosisSettings
from mcstudy.gap.trial_planning.choice import require_possible
from mcstudy.gap.trial_planning.next_trial import next_trial as planned_next
from mcstudy.identification.fit import fit as fit_recordings
from mcstudy.identification.settings import FitSettings
from mcstudy.recordings.columns import ModelLike, of_model
from mcstudy.recordings.frf import FrfRecording
from mcstudy.recordings.io import read_recording
from mcstudy.recordings.laboratory_import import import_files
from mcstudy.recordings.recording import Recording
from mcstudy.results.diagnosis import Diagnosis
from mcstudy.results.fit import FitResult
from mcstudy.results.next_trial import NextTrial
from mcstudy.scheduler.compiling import DIAGNOSIS, PERSON, compile_kernels
from mcstudy.stance.feedback import Model

RecordingLike = Recording | FrfRecording | str | Path
"""A recording, or the path of one."""


def diagnose(
    recording: RecordingLike | Sequence[RecordingLike],
    *,
    fast: bool = False,
    bootstrap: int | None = None,
    seed: int = 0,
    model: ModelLike | None = None,
    fmax: float | None = None,
    discard: int | None = None,
    accept: Iterable[str] = (),
    prior_none: float = NONE,
) -> Diagnosis:
    """Where the model fails on a recording, which effect is missing, and how far adding it closes the gap.

    Parameters
    ----------
    recording
        What `read_recording` or `simulate` returned, or a path; or several of one person. Those with the same stimulus,
        period and sampling rate are pooled, others analysed together: one body, and a noise for each.
    fast
        Asymptotic null distributions instead of a bootstrap that refits the model, which takes longer.
    bootstrap
        Null samples of the bootstrap; 1000 when None.
    seed
        Random seed; the same seed gives the same numbers.
    model
        Base model: a `Model`, a name or the file of one; the two-segment model of the recording's body when None. The
        outputs of a declared model are found in the recording by name. None under several stimuli.
    fmax
        Highest frequency used, Hz. None for 8, or the last of a published response; for a declared model a quarter
        of its sampling rate.
    discard
        Transient cycles left out at the start of every trial; None for one, or as many as the slowest oscillation of
        the fitted body needs to decay, at most half of a trial.
    accept
        Codes of warnings about mislabelled channels that are to be accepted, e.g. ``"swapped"``.
    prior_none
        Prior probability that no effect is missing; the other prior probabilities keep their ratios.

    Returns
    -------
    Diagnosis
        With ``verdict()``, ``plot``, ``to_html(path)`` and ``to_dict()``.

    Raises
    ------
    RecordingError
        A recording cannot be analysed, or its channels are not what their labels say.
    InputError
        ``bootstrap`` was given together with ``fast``, or ``prior_none`` is no probability between 0 and 1.
    """
    settings = DiagnosisSettings(
        fast=fast,
        bootstrap=bootstrap,
        seed=seed,
        model=model if isinstance(model, Model) else None,
        fmax=fmax,
        discard=discard,
        accept=accept,
        prior_none=prior_none,
    )
    given = read(recording, model)
    compile_kernels(DIAGNOSIS)
    return Diagnosis.of(diagnose_recordings(given, settings))


def next_trial(
    recording: RecordingLike | Sequence[RecordingLike],
    *,
    kinds: Sequence[str] = (),
    amplitudes: Mapping[str, Sequence[float]] | None = None,
    trials: Sequence[int] = (1, 2),
    cycles: int = 6,
    fmax: float | None = None,
    discard: int | None = None,
    accept: Iterable[str] = (),
    prior_none: float = NONE,
    seed: int = 0,
) -> NextTrial:
    """Which trial to record next: possible ones, ranked by their expected information about the cause.

    Parameters
    ----------
    recording
        What was recorded so far, as for `diagnose`.
    kinds
        Kinds of stimulus to consider; ankle and hip torque, platform translation and the recorded ones when empty.
    amplitudes
        Peaks to consider by kind, N m, m or rad. Where none is given, the recorded one, or the one that evokes no more
        sway than was recorded.
    trials, cycles
        Numbers of trials to consider, and periods of each.
    fmax, discard, accept, prior_none, seed
        As for `diagnose`.

    Returns
    -------
    NextTrial
        With ``best``, ``options``, ``text()``, ``to_dict()`` and ``to_html(path)``.

    Raises
    ------
    RecordingError
        A recording cannot be analysed, or none has a period.
    InputError
        A kind, an amplitude or a number of trials is not possible.
    """
    require_possible(kinds, amplitudes or {}, trials=trials, cycles=cycles)
    settings = DiagnosisSettings(
        fast=True, seed=seed, fmax=fmax, discard=discard, accept=accept, prior_none=prior_none, asked=CAUSE_ONLY
    )
    given = read(recording)
    compile_kernels(DIAGNOSIS)
    diagnosis = diagnose_recordings(given, settings)
    planned = planned_next(diagnosis, kinds, amplitudes, trials=trials, cycles=cycles, seed=seed)
    return NextTrial.of(planned)


def fit(
    recording: RecordingLike | Sequence[RecordingLike],
    *,
    effects: Sequence[str] = (),
    quantities: Sequence[str] | Mapping[str, Any] = (),
    bounds: Mapping[str, tuple[float, float]] | None = None,
    level: float = 0.95,
    causes: bool | None = None,
    model: ModelLike | None = None,
    fmax: float | None = None,
    discard: int | None = None,
    accept: Iterable[str] = (),
    seed: int = 0,
) -> FitResult:
    """Parameters of the person in a recording, with profile likelihood intervals and no prior.

    Parameters
    ----------
    recording
        What `read_recording` or `simulate` returned, or a path; or several of one person. Those with the same stimulus,
        period and sampling rate are pooled, others analysed together: one body, and a noise for each.
    effects
        Names of linear `effects` that are added to the model; their sizes are estimated too.
    quantities
        Further quantities beside the parameters and the sums K11 + Kpas1 and K22 + Kpas2: expressions such as
        ``"K11 + Kpas1 - 490"``, or a mapping from names to expressions and to functions of a mapping of parameters.
    bounds
        Bounds of parameters by name, in their unit. By default gains lie between 0 and 5 times the value that is
        typical of the recording's body, delays between 0.01 and 0.3 s.
    level
        Level of the intervals.
    causes
        Whether parameters are also averaged over the causes of the diagnosis (``result.averaged``). None: where there
        is a gap and no effect is added.
    model
        A `Model`, a name or the file of one; the two-segment model of the recording's body when None. The outputs of a
        declared model are found in the recording by name, and its parameters have its bounds. None under several
        stimuli.
    fmax
        Highest frequency used, Hz. None for 8, or the last of a published response; for a declared model a quarter
        of its sampling rate.
    discard
        Transient cycles left out at the start of every trial; None for one, or as many as the slowest oscillation of
        the fitted body needs to decay, at most half of a trial.
    accept
        Codes of warnings about mislabelled channels that are to be accepted, e.g. ``"swapped"``.
    seed
        Random seed; the same seed gives the same numbers.

    Returns
    -------
    FitResult
        Estimates by name (``result["K11"].low``), ``text()``, ``plot``, ``to_html(path)``, ``to_xarray()`` and
        ``to_dict()``.

    Raises
    ------
    RecordingError
        A recording cannot be analysed, or its channels are not what their labels say.
    InputError
        An argument is wrong.
    """
    settings = FitSettings(
        effects=effects,
        quantities=quantities,
        bounds=bounds,
        level=level,
        causes=causes,
        model=model if isinstance(model, Model) else None,
        fmax=fmax,
        discard=discard,
        accept=accept,
        seed=seed,
    )
    given = read(recording, model)
    compile_kernels(PERSON)
    return FitResult.of(fit_recordings(given, settings))


def import_recording(
    files: str | Path | Sequence[str | Path],
    description: str | Path | None = None,
    **fields: Any,
) -> Recording:
    """A recording from a laboratory's files: MATLAB, C3D or text with columns.

    Parameters
    ----------
    files
        One path, or one per trial; an empty list when the description names them.
    description
        Path of a description of the files (.toml), or None; also accepted as ``map``.
    fields
        Fields of a description, which replace those of the file: ``channels={"stimulus": "torque"}``,
        ``units={"angle": "deg"}``, ``rate_hz=100.0``, ``body={"height": 1.80, "weight": 75.0}``; of one sway angle
        ``model="sensorimotor_integration"``, ``channels={"stimulus": "tilt", "sway": {"column": "COM", "of": "com"}}``.

    Returns
    -------
    Recording
        Checked; ``provenance`` says what was done to the data.

    Raises
    ------
    RecordingError
        The recording cannot be used; one line that names file and field.
    """
    given = [files] if isinstance(files, str | Path) else list(files)
    return import_files(given, fields.pop("map", None) if description is None else description, fields).recording


def read(
    recording: RecordingLike | Sequence[RecordingLike], model: ModelLike | None = None
) -> list[Recording | FrfRecording]:
    """Recordings from paths or as they are, as ones of a declared model where that is given."""
    given = [recording] if isinstance(recording, RecordingLike) else list(recording)
    return [read_recording(r, model=model) if isinstance(r, str | Path) else of_model(r, model) for r in given]
