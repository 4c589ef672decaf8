"""Results are made of records: the same fields, with what a record cannot say of itself."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import fields
from inspect import cleandoc
from pathlib import Path
from typing import Any, Self

from mcstudy.report.style import require_matplotlib
from mcstudy.short_repr import Summary


class Result(Summary):
    """What Python returns. A subclass derives from this class and from that of its record, in this order.

    Its docstring gets the attributes that the record states.
    """

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        _, heading, attributes = cleandoc(cls.__bases__[-1].__doc__ or "").partition("Attributes\n")
        cls.__doc__ = f"{cleandoc(cls.__doc__ or '')}\n\n{heading}{attributes}".rstrip()

    @classmethod
    def of(cls, record: Any) -> Self:
        """The result that has the fields of ``record``, an instance of the class of records it derives from."""
        return cls(**{f.name: getattr(record, f.name) for f in fields(record)})


class PagedResult(Result):
    """A result that can be written as a page."""

    @abstractmethod
    def _page(self) -> str:
        """The page; what draws it is imported here, because it needs matplotlib."""

    def to_html(self, path: str | Path) -> Path:
        """Write the result as a self-contained page, as the command line does; returns its path.

        Parameters
        ----------
        path
            File to write, ``.html``.

        Raises
        ------
        InputError
            matplotlib is not installed (the extra ``report``), or the file cannot be written.
        """
        require_matplotlib()
        from mcstudy.report.document import write_page

        return write_page(path, self._page)
