"""One file per format, each defines `EXPORT`; see gelforge.dataset.exports."""
