"""The path constraints that scenario files, `zmp-sqp check` and `import zmp_sqp` know by name.

One import line here makes a constraint known to all of them: the class is exported as
`zmp_sqp.NAME`, and its `name` becomes a `type` of `[[constraints]]` in scenario files and of
`--constraint`. Classes whose name is given by the user, such as `PathRows`, are exported only.
"""

from zmp_sqp.planning.constraints.path_rows import PathRows as PathRows
from zmp_sqp.planning.constraints.torque import TorqueLimits as TorqueLimits

# --- the lines above are the registry ---


def names() -> list[str]:
    """Names of the exported classes."""
    return sorted(name for name, value in globals().items() if isinstance(value, type))


def kinds() -> dict[str, type]:
    """Constraints that a text can name, by the name that it uses."""
    classes = (value for value in globals().values() if isinstance(value, type))
    named = ((getattr(value, "name", None), value) for value in classes)
    return {name: value for name, value in named if isinstance(name, str)}
