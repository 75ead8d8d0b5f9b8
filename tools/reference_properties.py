"""`Properties`: lets the API reference show what `overridable` decorates as properties.

mkdocstrings reads the source with griffe, which would show a method. The site's configuration
names this file as an extension of griffe.
"""

from typing import Any

import griffe

__all__ = ["Properties"]


class Properties(griffe.Extension):
    """See the module's docstring."""

    def on_class_members(self, *, cls: griffe.Class, **kwargs: Any) -> None:  # of later versions
        """Replaces the decorated functions of a class."""
        for name, member in list(cls.members.items()):
            if not isinstance(member, griffe.Function):
                continue
            if any(str(one.value) == "overridable" for one in member.decorators):
                shown = griffe.Attribute(
                    name,
                    annotation=member.returns,
                    docstring=member.docstring,
                    lineno=member.lineno,
                    endlineno=member.endlineno,
                )
                shown.labels.add("property")
                cls.set_member(name, shown)
