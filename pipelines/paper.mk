# The experiments of the paper, each as a file: make paper-baxter, paper-dvrk, paper-shape-control, or
# all of them by make paper. Recordings and runs go to build/paper, tables and figures to docs/.
EXPERIMENTS := baxter dvrk shape-control

.PHONY: paper $(addprefix paper-,$(EXPERIMENTS))

paper: $(addprefix paper-,$(EXPERIMENTS))

$(addprefix paper-,$(EXPERIMENTS)): paper-%: $(STAMP)
	$(BIN)/python -m benchmarks.paper pipelines/$*.toml --write docs/paper.md
