"""Case files: TOML to the objects of rsgen, every fault at once; the only place that knows pydantic."""
