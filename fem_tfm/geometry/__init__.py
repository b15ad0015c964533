# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pipes, ducts and bends, the part of their section that is solved, and its meshes."""
