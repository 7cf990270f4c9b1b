"""What the paper prints: Tables I to V of Yang, Du, Li, Zhou and Zhang, "Physics-Informed Neural Network for Model
Prediction and Dynamics Parameter Identification of Collaborative Robot Joints"."""

from __future__ import annotations

from dataclasses import dataclass

# By parameter, SI units: truth, and estimates by method. The paper's tau_f,c is our tau_fc, tau_f,m our tau_fm.
TABLE_1 = {
    "R": (4.932e-1, {"H-PINN": 4.937e-1, "NLGR": 4.937e-1, "DeepXDE": 4.992e-1}),
    "c_b": (2.537e-4, {"H-PINN": 2.382e-4, "NLGR": 2.559e-4, "DeepXDE": 3.140e-4}),
    "k_b": (5.794e-2, {"H-PINN": 5.795e-2, "NLGR": 5.793e-2, "DeepXDE": 5.901e-2}),
    "k_t": (5.507e-2, {"H-PINN": 5.481e-2, "NLGR": 5.521e-2, "DeepXDE": 5.325e-2}),
    "tau_fc": (4.464e-2, {"H-PINN": 4.711e-2, "NLGR": 4.458e-2, "DeepXDE": 5.811e-3}),
}
TABLE_3 = {
    "R": (4.932e-1, {"H-PINN": 4.968e-1, "NLGR": 5.093e-1}),
    "c_b": (1.459e-4, {"H-PINN": 1.561e-4, "NLGR": 4.886e-4}),
    "k_b": (5.794e-2, {"H-PINN": 5.451e-2, "NLGR": 4.690e-2}),
    "k_t": (5.507e-2, {"H-PINN": 5.631e-2, "NLGR": 5.970e-2}),
    "c_m": (3.04e-2, {"H-PINN": 3.144e-2, "NLGR": 3.407e-2}),
    "c_1": (7.100, {"H-PINN": 7.621, "NLGR": 2.142e1}),
    "c_q": (4.031e1, {"H-PINN": 4.197e1, "NLGR": 2.662e1}),
    "k_1": (8.000e3, {"H-PINN": 8.265e3, "NLGR": 7.035e3}),
    "k_2": (4.000e5, {"H-PINN": 4.169e5, "NLGR": 6.023e5}),
    "tau_fm": (4.464e-2, {"H-PINN": 4.000e-2, "NLGR": 4.000e-2}),
}
# Estimates from a recording of a UR3e's base joint that is not public; of the truth only J_m = 6e-5 kg m^2 is known.
TABLE_5 = {
    "J_m": {"H-PINN": 5.529e-5, "NLGR": 7.673e-5},
    "J_q": {"H-PINN": 7.780e-1, "NLGR": 5.537e-1},
    "c_m": {"H-PINN": 1.018e-4, "NLGR": 1.150e-4},
    "c_q": {"H-PINN": 1.799, "NLGR": 1.688},
    "c_1": {"H-PINN": 18.938, "NLGR": 18.736},
    "k_1": {"H-PINN": 5.164e3, "NLGR": 5.003e3},
    "k_2": {"H-PINN": 9.021e8, "NLGR": 9.003e8},
    "tau_fm": {"H-PINN": 2.291e-2, "NLGR": 1.894e-2},
    "tau_fq": {"H-PINN": 2.296, "NLGR": 2.678},
}
TABLE_5_TIME = {"H-PINN": 480.56, "NLGR": 638.88}  # s


@dataclass(frozen=True)
class Row:
    """A row of Table II or IV: conditions, time in s and mean square error of the states."""

    method: str
    labels: str
    samples: int
    time_s: float
    mse: float
    epochs: int = 0


TABLE_2 = (
    Row("H-PINN", "2", 700, 61.17, 0.0355, 350),
    Row("H-PINN", "2", 500, 43.40, 0.0784, 350),
    Row("H-PINN", "1", 500, 44.03, 0.1212, 350),
    Row("DeepXDE", "2", 700, 330.32, 0.6759, 30000),
    Row("DeepXDE", "2", 500, 321.24, 0.7405, 30000),
    Row("DeepXDE", "1", 500, 256.16, 2.6606, 30000),
    Row("NLGR, sign", "2", 700, 286.97, 2.9694e-5),
    Row("NLGR, sign", "2", 500, 284.67, 2.9694e-5),
    Row("NLGR, sign", "1", 500, 251.34, 0.0894),
    Row("NLGR, tanh", "2", 700, 12.26, 2.9694e-5),
    Row("NLGR, tanh", "2", 500, 12.37, 2.9694e-5),
    Row("NLGR, tanh", "1", 500, 13.07, 0.0894),
)
TABLE_4 = (
    Row("H-PINN", "4", 500, 178.52, 0.0132, 300),
    Row("H-PINN", "5", 500, 179.81, 0.0237, 300),
    Row("H-PINN", "5 + torsion", 500, 183.14, 0.0095, 300),
    Row("NLGR, tanh", "4", 500, 55.77, 0.0130),
    Row("NLGR, tanh", "5", 500, 54.88, 0.0121),
    Row("NLGR, tanh", "5 + torsion", 500, 57.70, 0.0101),
)
