"""The path constraints that scenario files, `zmp-sqp check` and `import zmp_sqp` know by name.

One line here makes a constraint known to all of them: the class is exported as `zmp_sqp.NAME`, and
its `name` becomes a `type` of `[[constraints]]` in scenario files and of `--constraint`.
"""

from zmp_sqp.planning.constraints.path_rows import PathRows as PathRows
