"""Reports of extractions, pickled: objects of the same types that hold the facts of the originals."""
from __future__ import annotations

import copyreg
from typing import Any

from . import _core


class _Kept:
    """Looks attributes up in the kept facts, before the properties of the compiled type, which is empty."""

    def __init__(self, facts: "dict[str, Any]", text: str) -> None:
        super().__init__()
        self.__dict__.update(facts)
        self._text = text

    def __getattribute__(self, name: str) -> Any:
        kept = object.__getattribute__(self, "__dict__")
        return kept[name] if name in kept else object.__getattribute__(self, name)

    def __repr__(self) -> str:
        return str(self._text)

    def __reduce__(self) -> Any:
        return type(self), (_facts_of(self), self._text)


class _KeptReport(_Kept, _core.Report):
    pass


class _KeptQuality(_Kept, _core.TriangleQuality):
    pass


def _facts_of(report: Any) -> "dict[str, Any]":
    return {name: getattr(report, name) for name in dir(type(report)) if not name.startswith("_")}


def _pickled_report(report: _core.Report) -> Any:
    return _KeptReport, (_facts_of(report), repr(report))


def _pickled_quality(quality: _core.TriangleQuality) -> Any:
    return _KeptQuality, (_facts_of(quality), repr(quality))


def register() -> None:
    """Makes the reports of meshes picklable."""
    copyreg.pickle(_core.Report, _pickled_report)
    copyreg.pickle(_core.TriangleQuality, _pickled_quality)
