# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a run leaves behind: fields, profiles, pictures, the result and its summary."""
