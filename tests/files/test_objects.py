"""Objects of the package come back from bytes to the last bit, and bytes can make nothing else."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from mcstudy.files import objects
from mcstudy.files.objects import NotData, from_bytes, to_bytes
from mcstudy.fitting.arguments import Prior
from mcstudy.stance.body import Body
from mcstudy.stance.feedback import Filter, Monomial, Parameter


def back(value: object) -> Any:
    return from_bytes(to_bytes(value))


@pytest.mark.parametrize("value", [None, True, 0, -0.0, 5e-324, 0.1, math.inf, 1 << 80, "θ\n", 1 - 2j, (), [], {}])
def test_plain_values_come_back(value: object) -> None:
    assert repr(back([value, (value,)])) == repr([value, (value,)])
    assert math.isnan(back(math.nan))


def test_arrays_come_back_with_type_order_and_every_bit() -> None:
    grid = np.random.default_rng(0).normal(size=(3, 4))
    nan = np.frombuffer(b"\x01\x00\x00\x00\x00\x00\xf8\xff")  # not the usual one
    arrays = [
        grid,
        np.asfortranarray(grid),
        grid.astype(">f4"),
        grid > 0,
        grid + 1j,
        nan,
        np.array("ab"),
        np.empty((0, 2)),
    ]
    for found, one in zip(back(arrays), arrays, strict=True):
        assert (found.dtype, found.shape, found.tobytes("A")) == (one.dtype, one.shape, one.tobytes("A"))
        assert found.flags.f_contiguous == one.flags.f_contiguous
        assert found.flags.writeable
    assert back(grid[:, ::2]).tobytes() == grid[:, ::2].tobytes()
    for scalar in (np.float64(0.1), np.int32(3), np.bool_(True), np.complex128(1j)):
        assert type(back(scalar)) is type(scalar)
        assert back(scalar) == scalar


def test_dataclasses_with_and_without_slots_and_named_tuples_come_back() -> None:
    lag = Filter("lag", (Monomial(1.0, 0),), (Monomial(1.0, 0), Monomial(1.0, 1, (("tau", 1),))))
    parts = {"lag": lag, ("K", 1): Parameter("K", "N m/rad", 1.0, 0.0, 2.0), "body": Body()}
    assert back(parts) == parts
    prior = back(Prior(np.zeros(2), np.ones(2)))
    assert type(prior) is Prior
    assert (prior.mean.tolist(), prior.scale.tolist(), prior.weight) == ([0, 0], [1, 1], 1.0)


def test_shared_parts_are_shared_again() -> None:
    grid = np.zeros(3)
    first, second = back([{"a": grid}, (grid,)])
    assert first["a"] is second[0]


def test_what_is_kept_apart_is_not_written_and_put_back() -> None:
    signal = np.arange(1000.0)
    content = to_bytes({"signal": signal, "n": 1}, apart=[signal])
    assert signal[500:510].tobytes() not in content
    other = np.ones(2)
    assert from_bytes(content, apart=[other])["signal"] is other
    with pytest.raises(NotData, match="Body"):
        to_bytes([Body()], only_apart=Body)


class Plain:
    pass


@dataclass(frozen=True)
class Elsewhere:
    """A dataclass of another package."""

    x: float


class Named(NamedTuple):
    x: float


@pytest.mark.parametrize(
    "value",
    [
        print,
        Plain(),
        Elsewhere(1.0),
        Named(1.0),
        Path(),
        {1},
        b"",
        np.array([None]),
        np.ma.zeros(2),
        Body,
        np.datetime64(1, "s"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_nothing_else_is_written(value: object) -> None:
    with pytest.raises(NotData):
        to_bytes([value])


def test_what_an_object_computed_once_is_kept_and_what_it_did_not_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    @dataclass(frozen=True)
    class Sum:
        parts: tuple[float, ...] = field(default=(1.0, 2.0))

        @cached_property
        def total(self) -> float:
            return sum(self.parts)

    Sum.__module__, Sum.__qualname__ = objects.__name__, "Sum"
    monkeypatch.setattr(objects, "Sum", Sum, raising=False)
    one, other = Sum(), Sum()
    assert one.total == 3.0
    assert "total" in vars(back(one))
    assert "total" not in vars(back(other))


FORGED = {
    "a function": ["object", "mcstudy.files.objects", "to_bytes", {}],
    "a class that is no dataclass": ["object", "mcstudy.errors", "InputError", {}],
    "a class that was only imported there": ["object", "mcstudy.files.objects", "cached_property", {}],
    "a class of another package": ["object", "tests.files.test_objects", "Elsewhere", {"x": 1.0}],
    "a module that imports with an effect": ["object", "antigravity", "x", {}],
    "a part that is no field": ["object", "mcstudy.stance.body", "Body", {"__class__": 1}],
    "a named tuple that is none": ["named", "mcstudy.stance.body", "Body", []],
    "objects in an array": ["array", "|O", [1], "C", 0, 8],
    "an unknown kind": ["call", "os", "system", "true"],
}


@pytest.mark.parametrize("forged", FORGED.values(), ids=FORGED)
def test_forged_bytes_make_nothing_else(forged: list[Any]) -> None:
    with pytest.raises(NotData):
        from_bytes(json.dumps([forged, [0]]).encode() + b"\n" + bytes(8))
    assert "antigravity" not in sys.modules
