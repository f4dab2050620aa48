"""The one error of this package: a setting that cannot be used, said in one sentence."""

from __future__ import annotations


class ConfigError(ValueError):
    """A file, variable or option holds something that cannot be used.

    The text is meant for the person who wrote it: where it stands, which key, what was found
    and what is allowed. Several problems make several lines.
    """

    def __init__(self, *problems: str) -> None:
        self.problems = problems
        super().__init__("\n".join(problems))
