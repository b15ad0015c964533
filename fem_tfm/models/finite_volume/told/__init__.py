# SPDX-License-Identifier: LGPL-3.0-or-later
"""What an unsteady flow tells of itself: its pressure with the gas's weight, and its split."""
