"""The paper's experiments on ropes of simulators that are not ropefit's: see docs/paper.md."""
