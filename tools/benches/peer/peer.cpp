// The same work as rivet's period, as it is written today with Pinocchio and Eigen: the peer that rivet's cost is
// measured against. `rivet-peer` builds it, writes its problem file and runs it beside the Rust side on one core.
//
//   peer PROBLEM SECONDS
//
// Prints one line a kernel, `name nanoseconds` (median over batches), then `check name value` lines that the Rust side
// compares with its own results: both must have done the same work.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <string>
#include <vector>

#include "pinocchio/multibody.hpp"
#include "pinocchio/multibody/joint.hpp"
#include "pinocchio/algorithm/regressor.hpp"

#include <Eigen/Dense>

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

// What rivet-peer writes: text for what the arm is, the samples as plain columns.
struct Problem {
  pinocchio::Model model;
  double period = 0, forgetting = 1, sign_velocity = 0, threshold = 0;
  int dof = 0, driving = -1, driven = -1;
  bool offset = false;
  std::vector<int> base;              // standard columns that are kept
  MatrixXd sections;                  // b0 b1 b2 a1 a2, one row a second-order section
  MatrixXd weights;                   // (2m+1) x 3: position, velocity, acceleration
  VectorXd column, noise;             // scales
  MatrixXd samples;                   // rows: q, tau, q_des, qd_des, qdd_des
};

template <class M>
void read(std::istream& in, M& m) {
  for (Index i = 0; i < m.rows(); ++i)
    for (Index j = 0; j < m.cols(); ++j) in >> m(i, j);
}

// Gravity, then for each joint: rotation (row by row) and origin in the parent, axis, and m, m·c, Ixx Ixy Iyy Ixz Iyz Izz
// about the joint's origin, which is Pinocchio's own order.
void read_arm(std::istream& in, int dof, pinocchio::Model& model) {
  Eigen::Vector3d gravity, origin, axis;
  Eigen::Matrix3d rotation;
  Eigen::Matrix<double, 10, 1> body;
  read(in, gravity);
  model.gravity.linear() = gravity;
  pinocchio::JointIndex parent = 0;
  for (int j = 0; j < dof; ++j) {
    read(in, rotation), read(in, origin), read(in, axis), read(in, body);
    const pinocchio::SE3 placement(rotation, origin);
    const std::string name = "joint" + std::to_string(j + 1);
    if (axis == Eigen::Vector3d::UnitX()) parent = model.addJoint(parent, pinocchio::JointModelRX(), placement, name);
    else if (axis == Eigen::Vector3d::UnitY()) parent = model.addJoint(parent, pinocchio::JointModelRY(), placement, name);
    else if (axis == Eigen::Vector3d::UnitZ()) parent = model.addJoint(parent, pinocchio::JointModelRZ(), placement, name);
    else parent = model.addJoint(parent, pinocchio::JointModelRevoluteUnaligned(axis), placement, name);
    model.appendBodyToJoint(parent, pinocchio::Inertia::FromDynamicParameters(body), pinocchio::SE3::Identity());
  }
}

Problem load(const char* path) {
  std::ifstream in(path);
  Problem p;
  int sections = 0, taps = 0, columns = 0, rows = 0, offset = 0;
  in >> p.dof >> p.period >> p.forgetting >> p.sign_velocity >> p.threshold >> p.driving >> p.driven >> offset;
  p.offset = offset != 0;
  read_arm(in, p.dof, p.model);
  in >> columns;
  p.base.resize(columns);
  for (int& c : p.base) in >> c;
  in >> sections;
  p.sections.resize(sections, 5);
  read(in, p.sections);
  in >> taps;
  p.weights.resize(taps, 3);
  read(in, p.weights);
  p.column.resize(columns);
  read(in, p.column);
  p.noise.resize(p.dof);
  read(in, p.noise);
  in >> rows;
  p.samples.resize(rows, 5 * p.dof);
  read(in, p.samples);
  if (!in) {
    std::cerr << "peer: " << path << " is not a problem file of this version\n";
    std::exit(2);
  }
  return p;
}

double direction(double v, double v0) { return v0 > 0 ? std::tanh(v / v0) : (v > 0) - (v < 0); }

// Columns of the whole model, in rivet's order: links, drives, coupled motor.
struct Regressor {
  const Problem& p;
  const pinocchio::Model& model;
  pinocchio::Data data;
  MatrixXd full;

  Regressor(const Problem& p, const pinocchio::Model& model) : p(p), model(model), data(model) {
    full.setZero(p.dof, 10 * p.dof + (p.offset ? 4 : 3) * p.dof + (p.driving >= 0 ? 3 : 0));
  }

  void base_columns(const VectorXd& q, const VectorXd& v, const VectorXd& a, MatrixXd& out) {
    const int n = p.dof;
    full.leftCols(10 * n) = pinocchio::computeJointTorqueRegressor(model, data, q, v, a);
    for (int j = 0; j < n; ++j) {
      full(j, 10 * n + j) = a[j];
      full(j, 11 * n + j) = v[j];
      full(j, 12 * n + j) = direction(v[j], p.sign_velocity);
      if (p.offset) full(j, 13 * n + j) = 1;
    }
    if (p.driving >= 0) {
      const int x = p.driving, y = p.driven;
      const double s = direction(v[x] + v[y], p.sign_velocity);
      full.row(x).tail(3) << a[y], v[y], s;
      full.row(y).tail(3) << a[x], v[x], s;
    }
    for (size_t c = 0; c < p.base.size(); ++c) out.col(c) = full.col(p.base[c]);
  }
};

// Second-order sections over every entry of a matrix.
struct Filter {
  const MatrixXd& sections;
  std::vector<MatrixXd> s1, s2;
  MatrixXd in;

  Filter(const MatrixXd& sections, Index rows, Index columns) : sections(sections) {
    s1.assign(sections.rows(), MatrixXd::Zero(rows, columns));
    s2 = s1;
  }
  void step(MatrixXd& x) {
    for (Index k = 0; k < sections.rows(); ++k) {
      const auto c = sections.row(k);
      in = x;
      x = c[0] * in + s1[k];
      s1[k] = c[1] * in - c[3] * x + s2[k];
      s2[k] = c[2] * in - c[4] * x;
    }
  }
};

struct Period {
  const Problem& p;
  Regressor regressor;
  Index n, next = 0;
  MatrixXd window, motion, d, z, tau, dw, zw;
  VectorXd q, v, a, qd, vd, ad;
  Filter fd, fz, ft;
  MatrixXd M, S;
  VectorXd y, theta;
  Eigen::PartialPivLU<MatrixXd> lu;
  Eigen::SelfAdjointEigenSolver<MatrixXd> eigen;
  Index active = 0;

  Period(const Problem& p, const pinocchio::Model& model)
      : p(p), regressor(p, model), n(static_cast<Index>(p.base.size())), window(p.weights.rows(), p.dof),
        motion(3, p.dof), d(p.dof, n), z(p.dof, n), tau(p.dof, 1), fd(p.sections, p.dof, n), fz(p.sections, p.dof, n),
        ft(p.sections, p.dof, 1), lu(n), eigen(n) {
    M = S = MatrixXd::Identity(n, n) * 1e-9;
    y = theta = VectorXd::Zero(n);
  }

  // Differentiate, both regressors, model filter.
  void front() {
    const int j = p.dof;
    const Index taps = p.weights.rows(), rows = p.samples.rows() - taps;
    const Index at = next;
    next = next + 1 < rows ? next + 1 : 0;
    const auto now = p.samples.row(at + taps / 2);
    window = p.samples.block(at, 0, taps, j);
    motion.noalias() = p.weights.transpose() * window;
    q = motion.row(0), v = motion.row(1), a = motion.row(2);
    qd = now.segment(2 * j, j), vd = now.segment(3 * j, j), ad = now.segment(4 * j, j);
    tau = now.segment(j, j).transpose();
    regressor.base_columns(q, v, a, d);
    regressor.base_columns(qd, vd, ad, z);
    dw = d, zw = z;
    fd.step(dw), fz.step(zw), ft.step(tau);
  }

  void accumulate() {
    dw = p.noise.cwiseInverse().asDiagonal() * dw * p.column.cwiseInverse().asDiagonal();
    zw = p.noise.cwiseInverse().asDiagonal() * zw * p.column.cwiseInverse().asDiagonal();
    tau = p.noise.cwiseInverse().asDiagonal() * tau;
    M *= p.forgetting, y *= p.forgetting;
    M.noalias() += zw.transpose() * dw;
    y.noalias() += zw.transpose() * tau;
    S.triangularView<Eigen::Lower>() *= p.forgetting;
    S.selfadjointView<Eigen::Lower>().rankUpdate(zw.transpose());
  }

  void plain() {
    front();
    accumulate();
    lu.compute(M);
    theta = lu.solve(y);
  }

  // A full decomposition of the instruments' information each period; only the step along directions that it
  // identifies is taken.
  void supervised() {
    front();
    accumulate();
    eigen.compute(S);
    const auto& V = eigen.eigenvectors();
    const auto& values = eigen.eigenvalues();
    active = (values.array() > p.threshold).count();  // ascending order
    const auto moving = V.rightCols(active);
    lu.compute(M);
    const VectorXd step = lu.solve(y) - theta;
    theta += moving * (moving.transpose() * step);
  }
};

using Clock = std::chrono::steady_clock;

// Median over batches of the time of one call [ns].
template <class F>
double time(double seconds, F call) {
  double once = 0;
  long count = 1;
  for (;; count *= 2) {
    const auto start = Clock::now();
    for (long k = 0; k < count; ++k) call();
    once = std::chrono::duration<double>(Clock::now() - start).count();
    if (once > 2e-4) break;
  }
  const int batches = std::max(11, static_cast<int>(seconds / once));
  std::vector<double> times;
  for (int b = 0; b < batches; ++b) {
    const auto start = Clock::now();
    for (long k = 0; k < count; ++k) call();
    times.push_back(std::chrono::duration<double>(Clock::now() - start).count() / count * 1e9);
  }
  std::nth_element(times.begin(), times.begin() + batches / 2, times.end());
  return times[batches / 2];
}

template <class T>
void keep(const T& x) {
  asm volatile("" : : "m"(x) : "memory");
}

void report(const char* name, double ns) { std::printf("%s %.6g\n", name, ns); }

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    std::cerr << "usage: peer PROBLEM SECONDS\n";
    return 2;
  }
  const Problem p = load(argv[1]);
  const double seconds = std::atof(argv[2]);
  const pinocchio::Model& model = p.model;

  Regressor regressor(p, model);
  const int j = p.dof;
  std::vector<VectorXd> q, v, a;
  for (Index k = 0; k < 512; ++k) {
    const auto row = p.samples.row(k);
    q.push_back(row.segment(2 * j, j)), v.push_back(row.segment(3 * j, j)), a.push_back(row.segment(4 * j, j));
  }
  int k = 0;
  const auto next = [&] { k = (k + 1) & 511; };
  report("regressor", time(seconds, [&] {
           next();
           pinocchio::computeJointTorqueRegressor(model, regressor.data, q[k], v[k], a[k]);
           keep(regressor.data);
         }));
  Period period(p, model);
  const Index n = period.n;
  report("filter", time(seconds, [&] {
           period.dw.resize(j, n);
           period.fd.step(period.dw), period.fz.step(period.dw), period.ft.step(period.tau);
           keep(period.dw);
         }));
  Period a1(p, model), a2(p, model), a3(p, model);
  report("front", time(seconds, [&] { a1.front(); keep(a1.dw); }));
  report("plain", time(seconds, [&] { a2.plain(); keep(a2.theta); }));
  report("supervised", time(seconds, [&] { a3.supervised(); keep(a3.theta); }));
  // One pass over the samples, for the comparison.
  Period check(p, model);
  for (Index k = 0; k < p.samples.rows() - p.weights.rows(); ++k) check.front(), check.accumulate();
  std::printf("check trace %.15g\n", check.S.trace());
  MatrixXd d(j, n);
  regressor.base_columns(q[7], v[7], a[7], d);
  std::printf("check regressor %.15g\n", d.array().abs().sum());
  check.eigen.compute(check.S);
  std::printf("check largest %.15g\n", check.eigen.eigenvalues()[n - 1]);
}
