"""The sections of a study, a module for each; `gelforge.config` exports them."""
