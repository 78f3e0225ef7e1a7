"""The commands of `pilsim`, one a file: a frozen dataclass of options with a method `run`. Modules are imported in `run`, so that help is fast."""
