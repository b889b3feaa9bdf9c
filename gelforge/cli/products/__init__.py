"""What commands look up of a study: its laws, sites, sessions, shards and virtual lab, and where they lie."""
