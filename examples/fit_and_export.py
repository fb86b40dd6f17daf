"""From a recording to a rope in MuJoCo: EI with its interval, then the model as text.

python examples/fit_and_export.py [RECORDING] [OUT.xml]
"""

import sys
from pathlib import Path

import ropefit

recording = sys.argv[1] if len(sys.argv) > 1 else ropefit.sample("cloud")
out = Path(sys.argv[2] if len(sys.argv) > 2 else "rope.xml")

observations = ropefit.preprocess(recording)
model = ropefit.fit(observations)

EI = model.nominal.groups["group_0"].parameters["EI"]
print(f"EI = {EI.value:.4g} {EI.unit}, {EI.verdict}")
if EI.ci95:
    print(f"95 % interval {EI.ci95[0]:.4g} .. {EI.ci95[1]:.4g}")
print(f"frames that the fit never saw: {1e3 * (model.nominal.rms_heldout or 0):.2f} mm rms")

exported = ropefit.export(observations, model, "mujoco")
out.write_text(exported.text)
print(f"{out} written")
for sentence in exported.not_expressed:
    print(f"not expressed: {sentence}")
