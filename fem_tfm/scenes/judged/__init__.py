# SPDX-License-Identifier: LGPL-3.0-or-later
"""Judgement of a scene and of its answer: what cannot be, what is unlikely, what is no answer."""
