# SPDX-License-Identifier: LGPL-3.0-or-later
"""Laws of single particles: dispersion, impacts on walls, wear."""
