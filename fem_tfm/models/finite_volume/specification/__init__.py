# SPDX-License-Identifier: LGPL-3.0-or-later
"""The unsteady step as UFL forms on discontinuous spaces of degree 0: its specification."""
