# SPDX-License-Identifier: Apache-2.0
"""Programs that render the pictures and write the generated tables of the documentation."""
