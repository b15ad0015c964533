# SPDX-License-Identifier: LGPL-3.0-or-later
"""Laws of turbulence: eddy viscosity of the gas, of the solids, dispersion, Reynolds stresses."""
