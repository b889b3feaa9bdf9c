"""What commands look up of a study: its laws, sites, sessions, shards and virtual lab, and where they lie."""

from gelforge.cli.products.dataset import agreement_inputs, shard_paths
from gelforge.cli.products.laws import own_laws, read_laws, study_laws
from gelforge.cli.products.sessions import (
    feature_path,
    image_sessions,
    own_labels,
    print_findings,
    recording_of,
    session_of,
    session_presses,
)
from gelforge.cli.products.sites import cell_path, planned_cell, print_outcome, site_path
from gelforge.cli.products.virtual_lab import truth_folder, virtual_lab_of
