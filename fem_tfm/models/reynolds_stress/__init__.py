# SPDX-License-Identifier: LGPL-3.0-or-later
"""A turbulent gas by Reynolds stresses: its statement, weak forms, sections and heat."""
