"""The commands of `pilsim`, one a file: options as a frozen dataclass, and `run`. What they do is imported when they run: --help is fast."""
