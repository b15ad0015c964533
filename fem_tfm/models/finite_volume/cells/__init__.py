# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cells and faces of a mesh: geometry, operators, limiters, matrices and their solvers."""
