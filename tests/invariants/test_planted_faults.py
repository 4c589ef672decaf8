"""The planted faults (`tests/planted_faults.toml`) keep up with the sources."""

from __future__ import annotations

from tests.planted_faults import FAULTS, ROOT, place, sources


def test_every_fault_has_its_place_in_the_sources_and_tests_that_should_find_it() -> None:
    texts = sources(ROOT)
    for fault in FAULTS:
        assert place(texts, fault.right)
        assert fault.right != fault.wrong
        assert [name for name in fault.tests.split() if not (ROOT / "tests" / name).exists()] == [], fault.what
