"""Recordings with concealed effects, made by simulators that are not ropefit's."""
