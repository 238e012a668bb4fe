"""Does sampling agree with the exact law?

Four spacers, each ±0.1 mm: the law of their sum has a closed form, which needs no samples.
"""

import matplotlib.pyplot as plt
import numpy as np

import precision_pin as pp

model = pp.ErrorModel.from_dict(
    {
        "precision-pin": 1,
        "robot": "example:4dof",
        "tip": "tool",
        "gravity": "none",
        "poses": {"zero": "0 0 0 0 deg"},
        "sources": [{"length": {"frame": "tool", "along": "x of joint3", "parameters": ["±0.1 mm"] * 4}}],
    }
)

law = pp.exact_law(model, samples=1000).poses[0].laws["position.x"].law
sampled = pp.monte_carlo(model, samples=100_000, keep_samples=True).errors[0]
for probability in (0.5, 0.95, 0.9973):
    exact, estimate = 1e6 * law.quantile(probability), 1e6 * np.quantile(sampled, probability)
    print(f"{probability:.2%} quantile: {exact:6.2f} um, of the samples {estimate:6.2f} um")
print(
    f"beyond 0.39 mm: {1 - law.cumulative(np.array([0.39e-3]))[0]:.2e}, of the samples {np.mean(sampled > 0.39e-3):.0e}"
)

grid = np.linspace(-4e-4, 4e-4, 201)
figure, axes = plt.subplots(figsize=(4.5, 2.8), layout="constrained")
axes.hist(1e6 * sampled, 60, density=True, color="lightgrey", label="samples")
axes.plot(1e6 * grid, np.gradient(law.cumulative(grid), 1e6 * grid), label="exact law")
axes.set(xlabel="error in x, µm", yticks=[])
axes.legend()
figure.savefig("does_sampling_agree.png")
