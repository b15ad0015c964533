# SPDX-License-Identifier: LGPL-3.0-or-later
"""Every closure law by the name of its class: `laws.ThreeZone(C=0.5)`, `laws.Dartevelle()`.

A law that is registered stands here by itself; `fem-tfm models` lists them with formula and source.
"""

from __future__ import annotations

from typing import Any

from fem_tfm import closures

_LAWS = {law.__name__: law for law in closures.every_law()}
globals().update(_LAWS)
__all__ = sorted(_LAWS)


def __getattr__(name: str) -> type[Any]:
    """Raise with the nearest name for a law that does not exist."""
    from fem_tfm.errors import nearest

    near = nearest(name, _LAWS)
    hint = f"; did you mean {near}?" if near else ""
    raise AttributeError(f"there is no law {name!r}{hint}")
