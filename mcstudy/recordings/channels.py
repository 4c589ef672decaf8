"""From a description and its files to trials: variables are picked, converted, split and brought to one rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mcstudy.errors import RecordingError
from mcstudy.recordings.clock import SAME_RATE, Clock, clock_of
from mcstudy.recordings.columns import Columns
from mcstudy.recordings.data_files import Files
from mcstudy.recordings.displacement import angle_of
from mcstudy.recordings.faults import angle_faults
from mcstudy.recordings.formats.source import Picked
from mcstudy.recordings.markers import MarkerSheet, one_angle, space_angles
from mcstudy.recordings.recording import MOST_TRIALS, RATE_HZ, Trial, refuse_size
from mcstudy.recordings.refusals import require_within, size_text
from mcstudy.recordings.resampling import METHOD, filled, resampled, whole_samples
from mcstudy.recordings.sheets.body_sheet import Person
from mcstudy.recordings.sheets.recording_sheet import LARGEST_SCALE, Channel, Sheet, Starts, TrialSheet
from mcstudy.recordings.soundness import FILLABLE, without_gaps
from mcstudy.recordings.sway import unwrapped
from mcstudy.recordings.units import KINDS, agreed, factor, kind_of

SAME_LENGTH = 1.5
"""Largest difference in length of the channels of a trial after resampling, in samples; the excess is cut off."""


@dataclass(frozen=True)
class Series:
    """One channel of one trial.

    Attributes: channel; variable, its name in the file; unit, declared or stated by the file, or ``assumed`` to be
    ours; factor from that unit to ours; values (n,) in our unit, rad, N m or m; rate_hz; missing, how many values were
    interpolated; remarks, what was done to it, in words.
    """

    channel: str
    variable: str
    unit: str
    factor: float
    values: np.ndarray
    rate_hz: float
    missing: int = 0
    remarks: tuple[str, ...] = ()
    assumed: bool = False


@dataclass(frozen=True)
class Read:
    """One trial as it was read: ``parts`` are its channels before they are resampled."""

    file: str
    parts: tuple[Series, ...]
    trial: Trial
    rate_hz: float


def trials_of(
    sheet: Sheet, columns: Columns, files: Files, person: Person, where: str
) -> tuple[tuple[Read, ...], tuple[str, ...]]:
    """All trials of a description, with one rate, and what was done to them in words.

    ``person``: by which displacements become angles. Raises `RecordingError`, one line that names ``where``, the trial
    and the channel.
    """
    refuse_size(len(sheet.trials), 0, where)
    pieces: list[tuple[TrialSheet, tuple[Series, ...]]] = []
    for k, trial in enumerate(sheet.trials, start=1):
        for parts in _series(_File(sheet, columns, trial, files, person, f"{where}: trial {k}")):
            pieces.append((trial, parts))
            if len(pieces) > MOST_TRIALS:
                raise RecordingError(f"{where}: trials: expected at most {MOST_TRIALS}, got more")
            refuse_size(len(pieces), sum(p[0].values.size for _, p in pieces), where)
    rate = _common_rate(sheet, [parts for _, parts in pieces], where)
    done = [
        Read(trial.file or "", parts, _trial(sheet, columns, trial, parts, rate, f"{where}: trial {k}"), rate)
        for k, (trial, parts) in enumerate(pieces, start=1)
    ]
    return tuple(done), (*files.remarks(), *_notes(sheet, [parts for _, parts in pieces], rate))


def _common_rate(sheet: Sheet, trials: Sequence[tuple[Series, ...]], where: str) -> float:
    rates = [s.rate_hz for parts in trials for s in parts]
    for rate in rates:
        require_within(RATE_HZ, rate, f"{where}: rate_hz")
    require_within(RATE_HZ, sheet.resample_hz, f"{where}: resample_hz")
    if sheet.resample_hz is not None:
        return sheet.resample_hz
    lowest = min(rates)
    # Rates that are read from time columns differ in the last digits; without a stated one their median holds.
    if max(rates) / lowest - 1 <= SAME_RATE:
        return sheet.rate_hz or float(np.median(rates))
    first = trials[0]
    if len({s.rate_hz for s in first}) == 1:
        for k, parts in enumerate(trials, start=1):
            rate_of_trial = parts[0].rate_hz
            if len({s.rate_hz for s in parts}) == 1 and abs(rate_of_trial / first[0].rate_hz - 1) > SAME_RATE:
                raise RecordingError(
                    f"{where}: trial {k}: time: {rate_of_trial:g} Hz, but the first trials have "
                    f"{first[0].rate_hz:g} Hz; to bring them to one rate, state resample_hz"
                )
    return lowest


def _notes(sheet: Sheet, trials: Sequence[tuple[Series, ...]], rate: float) -> tuple[str, ...]:
    notes = list(dict.fromkeys(r for parts in trials for s in parts for r in s.remarks if r))
    changed = {(s.channel, s.rate_hz) for parts in trials for s in parts if abs(s.rate_hz / rate - 1) > SAME_RATE}
    for channel, rate_hz in sorted(changed):
        notes.append(f"{channel} resampled from {rate_hz:g} to {rate:g} Hz by a {METHOD}")
    if sheet.upper_body == "space":
        notes.append("theta2 is the upper body's angle in space minus theta1")
    if (m := sheet.markers) is not None and sheet.model is None:
        notes.append(
            f"theta1 from markers {' + '.join(m.ankle)} to {' + '.join(m.hip)}, theta2 from {' + '.join(m.hip)} to "
            f"{' + '.join(m.shoulder)} minus theta1; forward {m.forward}, up {m.up}"
        )
    if gaps := sum(s.missing for parts in trials for s in parts):
        notes.append(
            f"{gaps} missing, held or jumping values interpolated (monotone cubic, gaps up to {sheet.fill_gaps_s:g} s)"
        )
    if sheet.units.stated == "ignored":
        notes.append("units that the files state are ignored, as declared")
    return tuple(notes)


def _trial(
    sheet: Sheet, columns: Columns, trial: TrialSheet, parts: tuple[Series, ...], rate: float, where: str
) -> Trial:
    """A trial at the common rate; all channels begin at the same instant."""
    done = []
    for s in parts:
        same = abs(s.rate_hz / rate - 1) <= SAME_RATE
        if not same and s.channel != "stimulus":
            _require_whole(s, where)
        done.append(s.values if same else resampled(s.values, s.rate_hz, rate, f"{where}: {s.channel}"))
    shortest = min(v.size for v in done)
    for s, values in zip(parts, done, strict=True):
        if values.size - shortest > SAME_LENGTH:
            lasts = ", ".join(f"{p.channel} {p.values.size / p.rate_hz:g} s" for p in parts)
            raise RecordingError(f"{where}: {s.channel}: expected channels of one duration, got {lasts}")
    stimulus, *outputs = (v[:shortest] for v in done)
    if sheet.upper_body == "space" or (sheet.markers is not None and sheet.model is None):
        outputs[1] = outputs[1] - outputs[0]
    target = columns.stimulus_unit
    per = factor(sheet.units.stimulus or parts[0].unit, target, f"{where}: amplitude")
    return Trial(stimulus, np.column_stack(outputs), None if trial.amplitude is None else per * trial.amplitude)


def _require_whole(series: Series, where: str) -> None:
    """Raise `RecordingError` for an angle with a gap or a jump: a filter would spread it, and nobody could see it."""
    if not np.isfinite(series.values).all():
        return
    faults = angle_faults(series.values, series.rate_hz)
    if not faults:
        return
    first, longest = faults[0], max((f.stop - f.start) / series.rate_hz for f in faults)
    fill = all(f.kind in FILLABLE for f in faults)
    raise RecordingError(
        f"{where}: {series.channel}: {len(faults)} gaps or jumps (held values, spikes, steps), the first at "
        f"t = {first.start / series.rate_hz:.4g} s, the longest of {longest:.2g} s, which resampling would spread; "
        + (f"state fill_gaps_s (--fill-gaps {np.ceil(100 * longest) / 100:g})" if fill else "import at one common rate")
    )


@dataclass(frozen=True)
class _File:
    """What is read of one file: its description, the channels that are asked for, and of whom."""

    sheet: Sheet
    columns: Columns
    trial: TrialSheet
    files: Files
    person: Person
    where: str

    def given(self, name: str) -> Channel:
        """What is stated of a channel."""
        return self.trial.channel(name) or self.sheet.channels.channel(name) or Channel()


def _series(file: _File) -> list[tuple[Series, ...]]:
    """The channels of every trial in one file, split but each at its own rate."""
    sheet, where, outputs = file.sheet, file.where, file.columns.outputs
    if sheet.markers is not None and sheet.split.by is not None:
        raise RecordingError(f"{where}: split.by: expected no markers, which are read one trial per file")
    picked = ("stimulus", *outputs) if sheet.markers is None else ("stimulus",)
    columns = {name: _arranged(sheet, file.given(name), file.trial, name, file.files, where) for name in picked}
    clock = _clock(sheet, file.trial, columns["stimulus"][0], file.files, where)
    remark = ""
    if sheet.markers is not None:
        angles, remark = _of_markers(file, sheet.markers, clock)
        if len(angles) != len(outputs):
            raise RecordingError(f"{where}: markers: expected a model of one output, got {file.columns.names}")
        columns |= {name: [angle] for name, angle in zip(outputs, angles, strict=True)}
    counts = {name: len(trials) for name, trials in columns.items()}
    if len(set(counts.values())) > 1:
        numbers = ", ".join(f"{name} {n}" for name, n in counts.items())
        raise RecordingError(f"{where}: split.by: expected as many trials in every channel, got {numbers}")
    trials = ({name: columns[name][k] for name in ("stimulus", *outputs)} for k in range(counts["stimulus"]))
    return [parts for one in trials for parts in _pieces(file, one, clock, remark)]


def _of_markers(file: _File, markers: MarkerSheet, clock: _Timed | None) -> tuple[tuple[Picked, ...], str]:
    """The angles from markers: two of a standing body, one of a declared model; and what was done, in words."""
    sheet, where = file.sheet, file.where
    if file.trial.file is None:
        raise RecordingError(f"{where}: markers: expected a file")
    source = file.files.source(file.trial.file)

    def fill(p: Picked) -> Picked:
        rate = p.rate_hz or (clock.clock.rate_hz if clock else None) or sheet.rate_hz or 1.0
        longest = whole_samples(sheet.fill_gaps_s, rate)
        return replace(p, values=filled(p.values, longest, f"{where}: {p.name}", rate)[0])

    if sheet.model is None:
        return space_angles(markers, source, fill, where), ""
    angle, words = one_angle(markers, source, fill, file.person, where)
    return (angle,), words


def _pick_from(channel: Channel, trial: TrialSheet, name: str, where: str) -> tuple[str, str | int]:
    file = channel.file or trial.file
    if file is None:
        raise RecordingError(f"{where}: {name}: expected a file")
    return file, name if channel.column is None else channel.column


def _arranged(sheet: Sheet, channel: Channel, trial: TrialSheet, name: str, files: Files, where: str) -> list[Picked]:
    """One (n,) series per trial in the file."""
    file, key = _pick_from(channel, trial, name, where)
    source = files.source(file)
    by = sheet.split.by
    if by == "elements":
        return [_flat(p, f"{source.path}: {p.name}") for p in source.elements(str(key))]
    picked = source.pick(key)
    values = picked.values
    if by is None or values.ndim != 2:
        return [_flat(picked, f"{source.path}: {picked.name}")]
    table = values if by == "columns" else values.T
    if table.shape[1] > MOST_TRIALS:
        raise RecordingError(
            f"{source.path}: {picked.name}: expected at most {MOST_TRIALS} trials, got {table.shape[1]} {by}; "
            "is it the other way round?"
        )
    return [replace(picked, values=table[:, k]) for k in range(table.shape[1])]


def _flat(picked: Picked, where: str) -> Picked:
    values = picked.values
    if sum(n > 1 for n in values.shape) > 1:
        raise RecordingError(
            f"{where}: expected one row or column, got {size_text(values.shape)}; name a column as "
            f'{picked.name}[:,0], or state that trials are its columns (split by = "columns", --split columns)'
        )
    return replace(picked, values=values.ravel())


def _pieces(file: _File, picked: dict[str, Picked], clock: _Timed | None, remark: str) -> list[tuple[Series, ...]]:
    """Channels in our units, cut where trials start."""
    sheet, where = file.sheet, file.where
    units = file.columns.stimulus_unit, *file.columns.units
    parts = [_converted(file, name, unit, picked[name], clock) for name, unit in zip(picked, units, strict=True)]
    if remark:
        deg = factor("deg", units[1], where)
        parts[1] = replace(parts[1], unit="deg", factor=deg, remarks=(remark, *parts[1].remarks))
    for s in parts[1:]:
        if s.rate_hz == parts[0].rate_hz and s.values.size != parts[0].values.size:
            raise RecordingError(
                f"{where}: {s.channel}: {s.values.size} rows, but the stimulus has {parts[0].values.size}"
            )
    starts = _starts(sheet, file.trial, parts[0], file.files, where)
    if starts is None:
        return [tuple(parts)]
    return [tuple(_cut(s, begin, end, where) for s in parts) for begin, end in starts]


def _converted(file: _File, name: str, target: str, picked: Picked, clock: _Timed | None) -> Series:
    sheet, channel, where = file.sheet, file.given(name), f"{file.where}: {name}"
    if abs(channel.scale) < 1 / LARGEST_SCALE:
        raise RecordingError(
            f"{where}.scale: expected a size from {1 / LARGEST_SCALE:g} to {LARGEST_SCALE:g}, got {channel.scale:g}"
        )
    measured = "m" if channel.displacement else target
    unit = _unit(sheet, name, channel, picked, measured, where)
    scale = channel.scale * factor(unit or measured, measured, where)
    values, turns = (picked.values, 0) if measured != "rad" else unwrapped(picked.values * scale)
    values = values / scale if turns else picked.values
    timed = clock if clock is not None and picked.rate_hz in (None, clock.stated) and channel.rate_hz is None else None
    values = values if timed is None or values.size != timed.samples else timed.clock.regular(values)
    rate = _rate(sheet, channel, picked, timed, where)
    values, missing = values if scale == 1.0 else values * scale, 0
    if sheet.fill_gaps_s:
        values, missing = filled(values, whole_samples(sheet.fill_gaps_s, rate), where, rate)
        if name != "stimulus":
            values, more = without_gaps(values, rate, sheet.fill_gaps_s)
            missing += more
    wrapped = f"{name}: {turns} steps from 360 to 0 deg taken out" if turns else ""
    remarks = (timed.clock.remark if timed else "", wrapped)
    series = Series(name, picked.name, unit or measured, scale, values, rate, missing, remarks, assumed=unit is None)
    return _as_angle(series, channel, file.person, target, where) if channel.displacement else series


def _as_angle(series: Series, channel: Channel, person: Person, target: str, where: str) -> Series:
    """The angle that a displacement is, with what was done in its remarks."""
    if kind_of(target) != KINDS["rad"]:
        raise RecordingError(f"{where}: expected neither height nor of, because it is no angle ({target})")
    values = filled(series.values, 0, where, series.rate_hz)[0]
    angle, words = angle_of(values, series.variable, series.rate_hz, channel, person, where)
    remarks = (f"{series.channel} is {words}", *series.remarks)
    per, deg = factor("rad", target, where), factor("deg", target, where)
    return replace(series, values=per * angle, unit="deg", factor=deg, remarks=remarks)


def _unit(sheet: Sheet, name: str, channel: Channel, picked: Picked, target: str, where: str) -> str | None:
    """The unit of a channel, before its scale: declared, or stated by its file, and never of another kind."""
    general = sheet.units.stimulus if name == "stimulus" else sheet.units.angle
    general = None if channel.displacement else general
    from_markers = sheet.markers is not None and name != "stimulus"
    declared = None if from_markers else channel.unit or general
    stated = picked.unit or (picked.angle_unit if kind_of(target) == KINDS["rad"] else None)
    calibrated = abs(channel.scale) != 1.0  # the unit is that of the product: volts times N m per volt
    if sheet.units.stated == "ignored" or (calibrated and declared is not None):
        stated = None
    if target == "rad" and kind_of(declared or stated) == KINDS["m"] and not from_markers:
        raise RecordingError(
            f"{where}: expected an angle, got {picked.name} in {declared or stated}; of a displacement state what it "
            f'is of, {name} = {{column = ..., of = "com"}} (--sway-of com), or its height in m above the axis'
        )
    unit = agreed(declared, stated, target, where, picked.name)
    return "rad" if from_markers else unit


def _rate(sheet: Sheet, channel: Channel, picked: Picked, timed: _Timed | None, where: str) -> float:
    if timed is not None:
        return timed.clock.rate_hz
    declared = channel.rate_hz or sheet.rate_hz
    if picked.rate_hz is not None:
        if declared is not None and abs(picked.rate_hz / declared - 1) > SAME_RATE:
            raise RecordingError(
                f"{where}: rate_hz: declared {declared:g} Hz, but the file states {picked.rate_hz:g} Hz for "
                f"{picked.name}"
            )
        return picked.rate_hz
    if declared is None:
        raise RecordingError(
            f"{where.rsplit(': ', 1)[0]}: rate_hz: expected a rate or a time column (numbers, or time stamps)"
        )
    return declared


@dataclass(frozen=True)
class _Timed:
    """The clock of a file's time stamps: ``samples``, their number; ``stated``, the rate that the file states."""

    clock: Clock
    samples: int
    stated: float | None


def _clock(sheet: Sheet, trial: TrialSheet, stimulus: Picked, files: Files, where: str) -> _Timed | None:
    """The clock of a time column, None without one."""
    channel = trial.time or sheet.channels.time
    if channel is None:
        column = None if trial.file is None or sheet.split.by is not None else files.source(trial.file).time()
        if column is None:
            return None
        channel = Channel(column=column)
    file, key = _pick_from(channel, trial, "time", where)
    picked = _flat(files.source(file).pick(key), f"{where}: time")
    if picked.values.size != stimulus.values.size:
        raise RecordingError(f"{where}: time: {picked.values.size} rows, but the stimulus has {stimulus.values.size}")
    declared = channel.unit or (sheet.units.time if "time" in sheet.units.model_fields_set else None)
    stated = None if sheet.units.stated == "ignored" or abs(channel.scale) != 1.0 else picked.unit
    unit = agreed(declared, stated, "s", f"{where}: time", picked.name) or "s"
    scale = channel.scale * factor(unit, "s", f"{where}: time")
    rate = sheet.rate_hz or picked.rate_hz
    clock = clock_of(picked.values * scale, rate, sheet.resample_hz, sheet.fill_gaps_s, where)
    return _Timed(clock, picked.values.size, picked.rate_hz)


def _starts(
    sheet: Sheet, trial: TrialSheet, first: Series, files: Files, where: str
) -> list[tuple[float, float]] | None:
    """Begin and end of every trial in s from the first sample, None when the file holds one trial."""
    given, lasts = sheet.split.starts, first.values.size / first.rate_hz
    if given is None:
        return None
    where = f"{where}: split.starts"
    if isinstance(given, Starts):
        times = _event_times(given, first, trial, files, where)
    else:
        times = np.array(given, dtype=float)
    if times.size == 0:
        raise RecordingError(f"{where}: expected times at which trials start, found none")
    if not np.isfinite(times).all() or times.min() < 0 or times.max() >= lasts:
        raise RecordingError(f"{where}: expected times from 0 to {lasts:g} s, got {times.min():g} to {times.max():g} s")
    times = np.sort(times)
    ends = np.append(times[1:], lasts) if sheet.split.length_s is None else times + sheet.split.length_s
    if (over := np.flatnonzero(ends > lasts + 1 / first.rate_hz)).size:
        raise RecordingError(
            f"{where}: the trial at {times[over[0]]:g} s ends at {ends[over[0]]:g} s, after {lasts:g} s"
        )
    return [(float(a), float(b)) for a, b in zip(times, ends, strict=True)]


def _event_times(given: Starts, first: Series, trial: TrialSheet, files: Files, where: str) -> np.ndarray:
    if trial.file is None:
        raise RecordingError(f"{where}: expected a file")
    picked = _flat(files.source(trial.file).pick(given.column), where)
    if given.above is None:
        return picked.values * factor(given.unit, "s", where)
    rate = picked.rate_hz or first.rate_hz
    if picked.rate_hz is None and picked.values.size != first.values.size:
        raise RecordingError(f"{where}: {picked.values.size} rows, but the stimulus has {first.values.size}")
    return (np.flatnonzero(np.diff((picked.values > given.above).astype(np.int8)) > 0) + 1) / rate


def _cut(series: Series, begin: float, end: float, where: str) -> Series:
    a, b = round(begin * series.rate_hz), round(end * series.rate_hz)
    values = series.values[a:b]
    if values.size == 0:
        raise RecordingError(f"{where}: {series.channel}: no samples from {begin:g} to {end:g} s")
    return replace(series, values=values)
