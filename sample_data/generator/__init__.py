"""Makes ropefit's packaged sample recordings. Never imported by ropefit itself."""
