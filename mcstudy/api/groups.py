"""From recordings to groups of people, and from one person to a study."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from mcstudy.api.recordings import RecordingLike
from mcstudy.files.local_path import local_path
from mcstudy.identification.conditions.settings import ConditionSettings
from mcstudy.identification.people.fits import Known, fit_members
from mcstudy.identification.people.members import members
from mcstudy.identification.settings import FitSettings
from mcstudy.identification.study_design import study_of
from mcstudy.recordings.columns import ModelLike, model_of
from mcstudy.results.fit import FitResult
from mcstudy.results.group_result import GroupResult
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.study.design import Study


def fit_group(
    recordings: Sequence[RecordingLike | FitResult],
    *,
    person: Sequence[str],
    condition: Sequence[str] | None = None,
    paired: bool | None = None,
    per: Sequence[str] = (),
    shared: Sequence[str] = (),
    effects: Sequence[str] = (),
    quantities: Sequence[str] | Mapping[str, Any] = (),
    bounds: Mapping[str, tuple[float, float]] | None = None,
    level: float = 0.95,
    model: ModelLike | None = None,
    fmax: float | None = None,
    discard: int | None = None,
    accept: Iterable[str] = (),
    seed: int = 0,
    workers: int | None = None,
    scheduler: str | None = None,
) -> GroupResult:
    """Parameters of many people: each person's, their mean and spread, and differences between conditions.

    Parameters
    ----------
    recordings
        Recordings or paths, several of one person and condition are pooled; or results of `fit`, one for each person
        and condition, which are not computed again.
    person
        Name of the person in each recording.
    condition
        Name of the condition of each recording; one condition for all when None. The first one is the reference.
    paired
        True: every person must be in every condition, and is compared with itself. False: different people. None:
        paired if every person is in every condition, unpaired if nobody is in two.
    per, shared
        If one is given, all conditions of a person are fitted at once, as in `fit_conditions`: a parameter of ``per``
        has a mean for each condition, ``result["Wp_open", "all"]``, and a quantity such as ``"Wp_open - Wp_closed"``
        is their difference within people.
    effects, quantities, bounds, level, model, fmax, discard, accept, seed
        As in `fit`.
    workers
        Threads; one per core when None.
    scheduler
        Address of a running Dask scheduler, ``tls://host:port``; threads of this process when None.

    Returns
    -------
    GroupResult
        ``result["K11", "eyes open"]``, ``result.difference("K11")``, ``text()``, ``to_xarray()`` and ``to_dict()``.
        People who could not be fitted are in ``failed``.

    Raises
    ------
    InputError
        An argument is wrong, or fewer than two people in a condition could be fitted.
    Interrupted
        It was stopped.
    """
    known: list[Known] = [local_path(r) if isinstance(r, str) else r for r in recordings]
    settings = FitSettings(
        effects=effects,
        quantities=quantities,
        bounds=bounds,
        level=level,
        model=model_of(model),
        fmax=fmax,
        discard=discard,
        accept=accept,
        seed=seed,
    )
    if per or shared:
        settings = ConditionSettings(**vars(settings), per=per, shared=shared)
    options = ClusterOptions(workers=workers, scheduler=scheduler)
    return GroupResult.of(fit_members(members(known, person, condition), settings, options, pair=paired))


def study_from(
    fitted: FitResult, name: str = "experiment", *, realizations: int = 100, starts: int = 10, seed: int = 1
) -> Study:
    """A study of a person's experiment: the estimate as truth, with the same stimulus, noise, cycles and lines.

    Parameters
    ----------
    fitted
        What `fit` returned for a recording with a pseudorandom ternary stimulus.
    name
        Name of the study.
    realizations, starts
        Of its only group.
    seed
        Random seed of the study.

    Returns
    -------
    Study
        Several trials are one record with as many cycles; the noise has the form that all studies have, with the
        densities and the corner that explain the measured variances best.

    Raises
    ------
    InputError
        A study file cannot express this experiment, or its noise does not explain the measured sway.
    """
    return study_of(fitted, name, realizations=realizations, starts=starts, seed=seed)
