"""Fields that a digest omits while they are empty."""

from __future__ import annotations

# Fields that were added later: a digest omits them if empty, so that digests of older scores do not
# change.
OMIT_EMPTY = {"hash_omits_empty": True}
OMIT_NONE = {"hash_omits_none": True}
