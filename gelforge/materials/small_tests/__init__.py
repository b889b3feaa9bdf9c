"""Tests besides stress and stretch: friction, sheet thickness, a ball pressed into a layer, two load cells side by side."""
