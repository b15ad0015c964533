# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is told of particles: tables, files for ParaView, wear, pictures."""
