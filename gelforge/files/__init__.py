"""Files that are whole or absent, that show when they were changed, and digests of what made them.

A product that a later stage reads holds the SHA-256 of its own bytes as `sha256:` and 64 digits, which count as zeros in
the sum: in the user block of HDF5, in the comment of a zip archive (model.pt, npz), as the first key of JSON, as the name
of a last, empty column of a CSV table; of a verdict's tables verdict.json holds it. Other programs read such files as
before; who changes one seals it anew (`seal`).
"""

from gelforge.files.digests import digest, file_sha256, source_digest
from gelforge.files.products import (
    check_table_inputs,
    read_product_json,
    read_product_table,
    without_seal,
    write_json,
    write_product_json,
    write_product_table,
    write_table,
    write_text,
)
from gelforge.files.seals import UNSEALED, USER_BLOCK, FileError, check_seal, errno_of, seal, why_not_read
from gelforge.files.whole import atomic, no_room, remove_orphans, temporary_beside

__all__ = [
    "FileError",
    "UNSEALED",
    "USER_BLOCK",
    "atomic",
    "check_seal",
    "check_table_inputs",
    "digest",
    "errno_of",
    "file_sha256",
    "no_room",
    "read_product_json",
    "read_product_table",
    "remove_orphans",
    "seal",
    "source_digest",
    "temporary_beside",
    "why_not_read",
    "without_seal",
    "write_json",
    "write_product_json",
    "write_product_table",
    "write_table",
    "write_text",
]
