# SPDX-License-Identifier: LGPL-3.0-or-later
"""Slug conveying: discrete elements and a gas pressure field in a tube."""

from fem_tfm.scenes.slug import scene

__all__ = ["scene"]
