"""All mistakes that are known by name."""

from warpgrains.grade.contact_mistakes import CONTACT_MISTAKES
from warpgrains.grade.update_mistakes import UPDATE_MISTAKES

MISTAKES = (*CONTACT_MISTAKES, *UPDATE_MISTAKES)
