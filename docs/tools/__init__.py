# SPDX-License-Identifier: Apache-2.0
"""Programs that make the pictures and tables of the documentation."""
