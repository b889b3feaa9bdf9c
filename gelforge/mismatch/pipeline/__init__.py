"""From a recording and a study to a verdict, and what to record next."""
