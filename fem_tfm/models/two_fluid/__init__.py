# SPDX-License-Identifier: LGPL-3.0-or-later
"""The two-fluid model: its statement, weak forms, sections, starts and inlet."""
