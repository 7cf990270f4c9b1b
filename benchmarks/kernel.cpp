// The yardstick of `make bench-speed`: RK4 rollouts of Models 2 and 3 with all parameter sensitivities, written by hand.
//
// Everything a compiler can use is given to it: sizes known at compile time, columns of the sensitivities side by side in
// memory and padded to whole vectors, zeros and ones of the Jacobians left out by hand, what depends on parameters alone
// computed once.
#include <cmath>

namespace {

constexpr double N = 101.0;

// Columns of NP sensitivities up to the next cache line: loops without a remainder take 0.8 of the time with 9 columns
// and 0.6 with 10. What is added stays zero.
constexpr int padded(int NP) { return (NP + 7) / 8 * 8; }

template <int NX, int NP>
struct alignas(64) Columns {
  double v[NX][padded(NP)];
};

// Model 2: states theta_m, q, w_m, w_q; parameters J_m, c_m, tau_fm, c_1, k_1, k_2, J_q, c_q, tau_fq; input tau_m.
struct Model2 {
  static constexpr int NX = 4, NP = 9, NU = 1;
  double J_m, c_m, tau_fm, w_sm, c_1, k_1, k_2, J_q, c_q, tau_fq, w_sq;
  explicit Model2(const double* p)
      : J_m(1 / p[0]), c_m(p[1]), tau_fm(p[2]), w_sm(1 / p[3]), c_1(p[4]), k_1(p[5]), k_2(p[6]), J_q(1 / p[7]),
        c_q(p[8]), tau_fq(p[9]), w_sq(1 / p[10]) {}

  inline void operator()(const double* x, const double* u, double* f, const Columns<NX, NP>& S,
                         Columns<NX, NP>& D) const {
    const double twist = x[0] / N - x[1], rate = x[2] / N - x[3];
    const double spring = c_1 * rate + (k_1 + k_2 * twist * twist) * twist;
    const double sm = std::tanh(x[2] * w_sm), sq = std::tanh(x[3] * w_sq);
    f[0] = x[2];
    f[1] = x[3];
    f[2] = (u[0] - c_m * x[2] - tau_fm * sm - spring / N) * J_m;
    f[3] = (spring - c_q * x[3] - tau_fq * sq) * J_q;
    const double k = k_1 + 3 * k_2 * twist * twist;
    const double a20 = -k / (N * N) * J_m, a21 = k / N * J_m;
    const double a22 = (-c_m - tau_fm * w_sm * (1 - sm * sm) - c_1 / (N * N)) * J_m, a23 = c_1 / N * J_m;
    const double a30 = k / N * J_q, a31 = -k * J_q, a32 = c_1 / N * J_q;
    const double a33 = (-c_1 - c_q - tau_fq * w_sq * (1 - sq * sq)) * J_q;
    for (int j = 0; j < padded(NP); ++j) {
      D.v[0][j] = S.v[2][j];
      D.v[1][j] = S.v[3][j];
      D.v[2][j] = a20 * S.v[0][j] + a21 * S.v[1][j] + a22 * S.v[2][j] + a23 * S.v[3][j];
      D.v[3][j] = a30 * S.v[0][j] + a31 * S.v[1][j] + a32 * S.v[2][j] + a33 * S.v[3][j];
    }
    D.v[2][0] -= f[2] * J_m;
    D.v[2][1] -= x[2] * J_m;
    D.v[2][2] -= sm * J_m;
    const double m = J_m / N, cubic = twist * twist * twist;
    D.v[2][3] -= rate * m;
    D.v[3][3] += rate * J_q;
    D.v[2][4] -= twist * m;
    D.v[3][4] += twist * J_q;
    D.v[2][5] -= cubic * m;
    D.v[3][5] += cubic * J_q;
    D.v[3][6] -= f[3] * J_q;
    D.v[3][7] -= x[3] * J_q;
    D.v[3][8] -= sq * J_q;
  }
};

// Model 3: states i, theta_m, q, w_m, w_q; parameters R, k_b, k_t, c_b, c_m, tau_fm, c_1, k_1, k_2, c_q; input V_s.
struct Model3 {
  static constexpr int NX = 5, NP = 10, NU = 1;
  double R, L, k_b, k_t, c_b, J_m, c_m, tau_fm, w_sm, c_1, k_1, k_2, J_q, c_q;
  explicit Model3(const double* p)
      : R(p[0]), L(1 / p[1]), k_b(p[2]), k_t(p[3]), c_b(p[4]), J_m(1 / p[5]), c_m(p[6]), tau_fm(p[7]), w_sm(1 / p[8]),
        c_1(p[9]), k_1(p[10]), k_2(p[11]), J_q(1 / p[12]), c_q(p[13]) {}

  inline void operator()(const double* x, const double* u, double* f, const Columns<NX, NP>& S,
                         Columns<NX, NP>& D) const {
    const double twist = x[1] / N - x[2], rate = x[3] / N - x[4];
    const double spring = c_1 * rate + (k_1 + k_2 * twist * twist) * twist;
    const double sm = std::tanh(x[3] * w_sm);
    f[0] = (u[0] - R * x[0] - k_b * x[3]) * L;
    f[1] = x[3];
    f[2] = x[4];
    f[3] = (k_t * x[0] - (c_b + c_m) * x[3] - tau_fm * sm - spring / N) * J_m;
    f[4] = (spring - c_q * x[4]) * J_q;
    const double k = k_1 + 3 * k_2 * twist * twist;
    const double a00 = -R * L, a03 = -k_b * L;
    const double a30 = k_t * J_m, a31 = -k / (N * N) * J_m, a32 = k / N * J_m;
    const double a33 = (-c_b - c_m - tau_fm * w_sm * (1 - sm * sm) - c_1 / (N * N)) * J_m, a34 = c_1 / N * J_m;
    const double a41 = k / N * J_q, a42 = -k * J_q, a43 = c_1 / N * J_q, a44 = (-c_1 - c_q) * J_q;
    for (int j = 0; j < padded(NP); ++j) {
      D.v[0][j] = a00 * S.v[0][j] + a03 * S.v[3][j];
      D.v[1][j] = S.v[3][j];
      D.v[2][j] = S.v[4][j];
      D.v[3][j] =
          a30 * S.v[0][j] + a31 * S.v[1][j] + a32 * S.v[2][j] + a33 * S.v[3][j] + a34 * S.v[4][j];
      D.v[4][j] = a41 * S.v[1][j] + a42 * S.v[2][j] + a43 * S.v[3][j] + a44 * S.v[4][j];
    }
    D.v[0][0] -= x[0] * L;
    D.v[0][1] -= x[3] * L;
    D.v[3][2] += x[0] * J_m;
    D.v[3][3] -= x[3] * J_m;
    D.v[3][4] -= x[3] * J_m;
    D.v[3][5] -= sm * J_m;
    const double m = J_m / N, cubic = twist * twist * twist;
    D.v[3][6] -= rate * m;
    D.v[4][6] += rate * J_q;
    D.v[3][7] -= twist * m;
    D.v[4][7] += twist * J_q;
    D.v[3][8] -= cubic * m;
    D.v[4][8] += cubic * J_q;
    D.v[4][9] -= x[4] * J_q;
  }
};

template <class Model>
void rollout(const double* x0, const double* u, const double* p, int samples, double h, int substeps, double* X,
             double* J) {
  constexpr int NX = Model::NX, NP = Model::NP;
  const Model model(p);
  double x[NX];
  Columns<NX, NP> S{}, D[4], T;
  for (int i = 0; i < NX; ++i) x[i] = x0[i];
  const double hs = h / substeps;
  const double at[3] = {0.5 * hs, 0.5 * hs, hs};
  for (int t = 0;; ++t) {
    for (int i = 0; i < NX; ++i) X[t * NX + i] = x[i];
    for (int i = 0; i < NX; ++i)
      for (int j = 0; j < NP; ++j) J[(t * NX + i) * NP + j] = S.v[i][j];
    if (t == samples - 1) return;
    for (int s = 0; s < substeps; ++s) {
      double f[4][NX], y[NX];
      model(x, u + t * Model::NU, f[0], S, D[0]);
      for (int k = 0; k < 3; ++k) {
        for (int i = 0; i < NX; ++i) y[i] = x[i] + at[k] * f[k][i];
        for (int i = 0; i < NX; ++i)
          for (int j = 0; j < padded(NP); ++j) T.v[i][j] = S.v[i][j] + at[k] * D[k].v[i][j];
        model(y, u + t * Model::NU, f[k + 1], T, D[k + 1]);
      }
      for (int i = 0; i < NX; ++i) x[i] += hs / 6 * (f[0][i] + 2 * f[1][i] + 2 * f[2][i] + f[3][i]);
      for (int i = 0; i < NX; ++i)
        for (int j = 0; j < padded(NP); ++j)
          S.v[i][j] += hs / 6 * (D[0].v[i][j] + 2 * D[1].v[i][j] + 2 * D[2].v[i][j] + D[3].v[i][j]);
    }
  }
}

}  // namespace

extern "C" {

// x0 (NX), u (samples), p all parameters in the model's order without N (Model 3: also without tau_fq and w_sq),
// h in s, substeps a sample. X (samples, NX) and J (samples, NX, NP) receive states and sensitivities.
void model2(const double* x0, const double* u, const double* p, int samples, double h, int substeps, double* X,
            double* J) {
  rollout<Model2>(x0, u, p, samples, h, substeps, X, J);
}

void model3(const double* x0, const double* u, const double* p, int samples, double h, int substeps, double* X,
            double* J) {
  rollout<Model3>(x0, u, p, samples, h, substeps, X, J);
}
}
