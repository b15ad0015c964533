# SPDX-License-Identifier: LGPL-3.0-or-later
"""Particles of a scene: what is said of them, and how they are followed through its gas."""
