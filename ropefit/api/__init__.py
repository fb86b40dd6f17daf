"""What ropefit does, as functions.

`memory`: artifacts in, an artifact out, nothing on disk; these are the names of `import ropefit`.
`runs`: the same in a run directory, as the command line and a batch do it. `summaries`: what
`--json` says of what came out.
"""
