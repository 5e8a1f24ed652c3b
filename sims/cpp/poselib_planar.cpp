// PoseLib's LO-RANSAC around its planar minimal solvers: of each pair of views, the two headings.
//
//     poselib_planar 2pt|3pt ITERATIONS|adaptive THRESHOLD < pairs > headings   (protocol.hpp)
//
// PoseLib has solvers for the plane but no robust estimator that uses them. Here is one, written as
// its RelativePoseEstimator is: its loop, its sampler, truncated squares, a local fit. Residuals
// are those of the planar epipolar constraint on the sphere, to first order in the noise (Sampson).
#include "protocol.hpp"

#include <PoseLib/camera_pose.h>
#include <PoseLib/robust/ransac_impl.h>
#include <PoseLib/robust/sampling.h>
#include <PoseLib/solvers/relpose_upright_planar_2pt.h>
#include <PoseLib/solvers/relpose_upright_planar_3pt.h>

#include <algorithm>

namespace {

using Rays = std::vector<Eigen::Vector3d>;
using Solver = int (*)(const Rays &, const Rays &, poselib::CameraPoseVector *);

// A unit vector in the plane, x forward, y left: scoring a model needs no trigonometry. Not a
// number until it is found, so that a loop that finds nothing answers that.
struct Direction {
    double cos = std::numeric_limits<double>::quiet_NaN();
    double sin = std::numeric_limits<double>::quiet_NaN();

    void turn(double angle) {
        const double c = std::cos(angle), s = std::sin(angle);
        *this = {c * cos - s * sin, s * cos + c * sin};
    }
    double angle() const { return std::atan2(sin, cos); }
};

struct Model {
    Direction l, r; // to the other view
};

// PoseLib wants rays in a camera's frame: x right, y down, z where the robot looks.
Eigen::Vector3d ray(double azimuth, double elevation) {
    const double along = std::cos(elevation);
    return {-along * std::sin(azimuth), -std::sin(elevation), along * std::cos(azimuth)};
}

Direction direction_of(const Eigen::Vector3d &camera) { return {camera.z(), -camera.x()}; }

class PlanarEstimator {
  public:
    PlanarEstimator(const protocol::Pair &pair, Solver solver, size_t size, double threshold)
        : sample_sz(size), num_data(pair.size()), solver(solver), limit(threshold * threshold),
          sampler(num_data, sample_sz), sample(size), sampled_l(size), sampled_r(size),
          terms(num_data * WIDTH) {
        for (size_t i = 0; i < num_data; ++i) {
            rays_l.push_back(ray(pair[i].azimuth_l, pair[i].elevation_l));
            rays_r.push_back(ray(pair[i].azimuth_r, pair[i].elevation_r));
            size_t k = 0;
            const protocol::Correspondence &c = pair[i];
            for (const double angle : {c.azimuth_l, c.elevation_l, c.azimuth_r, c.elevation_r}) {
                terms[k++ * num_data + i] = std::cos(angle);
                terms[k++ * num_data + i] = std::sin(angle);
            }
        }
    }

    void generate_models(std::vector<Model> *models) {
        sampler.generate_sample(&sample);
        for (size_t k = 0; k < sample_sz; ++k) {
            sampled_l[k] = rays_l[sample[k]];
            sampled_r[k] = rays_r[sample[k]];
        }
        solver(sampled_l, sampled_r, &poses);
        for (const poselib::CameraPose &pose : poses)
            models->push_back({direction_of(pose.center()), direction_of(pose.t)});
    }

    double score_model(const Model &model, size_t *inlier_count) const {
        double cost = 0.0, agreeing = 0.0;
#pragma omp simd reduction(+ : cost, agreeing)
        for (size_t i = 0; i < num_data; ++i) {
            const double squared = residual(model, i).squared();
            cost += std::min(limit, squared);
            agreeing += squared < limit ? 1.0 : 0.0;
        }
        *inlier_count = static_cast<size_t>(agreeing);
        return cost;
    }

    // Gauss-Newton over the two headings on what agrees, which is found anew at each step; the
    // variance counts as constant within a step.
    void refine_model(Model *model) const {
        for (int step = 0; step < STEPS; ++step) {
            double ll = 0.0, lr = 0.0, rr = 0.0, l = 0.0, r = 0.0;
#pragma omp simd reduction(+ : ll, lr, rr, l, r)
            for (size_t i = 0; i < num_data; ++i) {
                const Residual at = residual(*model, i);
                const double weight = at.squared() < limit ? 1.0 / at.variance : 0.0;
                ll += weight * at.slope_l * at.slope_l;
                lr += weight * at.slope_l * at.slope_r;
                rr += weight * at.slope_r * at.slope_r;
                l += weight * at.slope_l * at.value;
                r += weight * at.slope_r * at.value;
            }
            const double determinant = ll * rr - lr * lr;
            if (!(determinant > 1e-12 * ll * rr))
                return; // the correspondences leave a heading open
            const double turn_l = (lr * r - rr * l) / determinant;
            const double turn_r = (lr * l - ll * r) / determinant;
            model->l.turn(turn_l);
            model->r.turn(turn_r);
            if (std::abs(turn_l) + std::abs(turn_r) < 1e-5)
                return;
        }
    }

    const size_t sample_sz;
    const size_t num_data;

  private:
    // The planar epipolar constraint at a model: its value, derivatives by the two headings, and
    // its variance for isotropic noise of one radian in both rays.
    struct Residual {
        double value, slope_l, slope_r, variance, behind;

        // In radians squared; without end where the rays meet behind a view.
        double squared() const {
            const double square = value * value / variance;
            return behind > 0.0 ? std::numeric_limits<double>::infinity() : square;
        }
    };

    Residual residual(const Model &model, size_t i) const {
        const double *t = terms.data() + i;
        const size_t n = num_data;
        const double cos_l = t[0], sin_l = t[n], along_l = t[2 * n], up_l = t[3 * n];
        const double cos_r = t[4 * n], sin_r = t[5 * n], along_r = t[6 * n], up_r = t[7 * n];
        // sines and cosines of u and v, from the azimuths to the headings
        const double su = model.l.sin * cos_l - model.l.cos * sin_l;
        const double cu = model.l.cos * cos_l + model.l.sin * sin_l;
        const double sv = model.r.sin * cos_r - model.r.cos * sin_r;
        const double cv = model.r.cos * cos_r + model.r.sin * sin_r;
        // p sin u + q sin v, and its slopes as either ray moves sideways or up
        const double p = up_r * along_l, q = up_l * along_r;
        const double flat = along_l * along_r, steep = up_l * up_r;
        const double side_l = up_r * cu, rise_l = flat * sv - steep * su;
        const double side_r = up_l * cv, rise_r = flat * su - steep * sv;
        const double variance =
            side_l * side_l + rise_l * rise_l + side_r * side_r + rise_r * rise_r + 1e-24;
        // the baseline is the third side of a triangle with the lines of sight: both go to its apex
        const double apex = su * cv - cu * sv;
        return {p * su + q * sv, p * cu, q * cv, variance, std::max(sv * apex, -su * apex)};
    }

    static constexpr size_t WIDTH = 8;
    static constexpr int STEPS = 5;

    const Solver solver;
    const double limit;
    poselib::RandomSampler sampler;
    Rays rays_l, rays_r;
    std::vector<size_t> sample;
    Rays sampled_l, sampled_r;
    poselib::CameraPoseVector poses;
    std::vector<double> terms; // (WIDTH, num_data): a vector register holds several points
};

} // namespace

int main(int argc, char **argv) {
    return protocol::serve(argc, argv, [](const std::vector<std::string> &arguments) {
        if (arguments.size() != 3 || (arguments[0] != "2pt" && arguments[0] != "3pt"))
            throw std::runtime_error("arguments: 2pt|3pt ITERATIONS|adaptive THRESHOLD");
        const bool two = arguments[0] == "2pt";
        const double threshold = protocol::positive<double>(arguments[2], "THRESHOLD");
        poselib::RansacOptions options;
        options.success_prob = 0.9999; // of adaptive stopping, with PoseLib's factor of three
        options.min_iterations = 20;
        options.max_iterations = 10'000;
        if (arguments[1] != "adaptive")
            options.min_iterations = options.max_iterations =
                protocol::positive<int>(arguments[1], "ITERATIONS");

        return [=](const protocol::Pair &pair) -> protocol::Headings {
            const Solver solver =
                two ? poselib::relpose_upright_planar_2pt : poselib::relpose_upright_planar_3pt;
            PlanarEstimator estimator(pair, solver, two ? 2 : 3, threshold);
            Model best;
            poselib::ransac(estimator, options, &best);
            // the loop keeps a fit only if it lowers the truncated score; the answer is the fit
            // itself, as in PoseLib's estimate_relative_pose
            estimator.refine_model(&best);
            return {best.l.angle(), best.r.angle()};
        };
    });
}
