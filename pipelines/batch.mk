# make -j2 batch RECORDINGS="a b c" RUNS=out
#
# Each stage of each recording is a file that depends on the one before it, so only what changed is redone
# and recordings run side by side. Options of a stage: PREPROCESS=..., IDENTIFY=..., DIAGNOSE=..., CONTROL=...
# The paper's weights, and fits by its losses, are not diagnosed: they are no properties of a rope.
RECORDINGS ?=
RUNS       ?= out
ROPEFIT    := $(BIN)/ropefit

# The run of a recording is named after its last folder.
run_of = $(RUNS)/$(notdir $(patsubst %/,%,$(1)))

PAPER := $(filter jacobi thomas gradient grid,$(subst =, ,$(IDENTIFY)))

define stages
$(2)/observations.h5: $(wildcard $(1)/* $(1)/*/*) | $(STAMP)
	$(ROPEFIT) preprocess $(1) --run $(2) $(PREPROCESS)
	@touch $$@
$(2)/model.h5: $(2)/observations.h5
	$(ROPEFIT) identify --run $(2) $(IDENTIFY)
	@touch $$@
$(2)/diagnosis.h5: $(2)/model.h5
	$(ROPEFIT) diagnose --run $(2) $(DIAGNOSE)
	@touch $$@
$(2)/control.h5: $(2)/model.h5 $(if $(PAPER),,$(2)/diagnosis.h5)
	$(ROPEFIT) control --run $(2) $(CONTROL)
	@touch $$@
$(2)/report.html: $(2)/control.h5
	$(ROPEFIT) report --run $(2)
endef

RUN_NAMES := $(foreach r,$(RECORDINGS),$(call run_of,$(r)))

ifneq (,$(filter batch,$(MAKECMDGOALS)))
  ifeq (,$(strip $(RECORDINGS)))
    $(error usage: make batch RECORDINGS="a b c" RUNS=out)
  endif
  ifneq ($(words $(RUN_NAMES)),$(words $(sort $(RUN_NAMES))))
    $(error two recordings have the same folder name; run them with different RUNS)
  endif
endif

$(foreach r,$(RECORDINGS),$(eval $(call stages,$(patsubst %/,%,$(r)),$(call run_of,$(r)))))

batch: $(addsuffix /report.html,$(RUN_NAMES))
