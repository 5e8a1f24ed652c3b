// OpenGV's RANSAC of central relative poses, then its non-linear refinement on the inliers: of each
// pair of views, the two headings.
//
//     opengv_peers stewenius|nister|eightpt ITERATIONS THRESHOLD < pairs > headings (protocol.hpp)
//
// It estimates all six degrees of freedom. It stops early as OpenGV does (probability 0.99), so
// ITERATIONS is the most it makes. THRESHOLD is in radians.
#include "protocol.hpp"

#include <opengv/relative_pose/CentralRelativeAdapter.hpp>
#include <opengv/sac/Ransac.hpp>
#include <opengv/sac_problems/relative_pose/CentralRelativePoseSacProblem.hpp>

#include <map>
#include <memory>

namespace {

using Problem = opengv::sac_problems::relative_pose::CentralRelativePoseSacProblem;

// Bearings stay in the robot's frame: six degrees of freedom know no up.
opengv::bearingVector_t bearing(double azimuth, double elevation) {
    const double along = std::cos(elevation);
    return {along * std::cos(azimuth), along * std::sin(azimuth), std::sin(elevation)};
}

protocol::Headings estimate(const protocol::Pair &pair, Problem::algorithm_t algorithm,
                            int iterations, double threshold) {
    opengv::bearingVectors_t left, right;
    for (const protocol::Correspondence &match : pair) {
        left.push_back(bearing(match.azimuth_l, match.elevation_l));
        right.push_back(bearing(match.azimuth_r, match.elevation_r));
    }
    opengv::relative_pose::CentralRelativeAdapter adapter(left, right);
    // false: the generator is not seeded by the clock
    const auto problem = std::make_shared<Problem>(adapter, algorithm, false);
    if (static_cast<int>(pair.size()) < problem->getSampleSize())
        return {};
    // OpenGV's distance is the sum of 1 - cos of both views' errors: half of Sampson's square
    opengv::sac::Ransac<Problem> ransac(iterations, 1.0 - std::cos(threshold));
    ransac.sac_model_ = problem;
    if (!ransac.computeModel())
        return {};
    opengv::transformation_t pose = ransac.model_coefficients_;
    if (ransac.inliers_.size() >= 5)
        problem->optimizeModelCoefficients(ransac.inliers_, ransac.model_coefficients_, pose);
    // x_l = R x_r + t: t is where R stands in L's frame
    const Eigen::Vector3d other_l = pose.col(3);
    const Eigen::Vector3d other_r = -pose.leftCols<3>().transpose() * other_l;
    return {std::atan2(other_l.y(), other_l.x()), std::atan2(other_r.y(), other_r.x())};
}

} // namespace

int main(int argc, char **argv) {
    return protocol::serve(argc, argv, [](const std::vector<std::string> &arguments) {
        const std::map<std::string, Problem::algorithm_t> algorithms = {
            {"stewenius", Problem::STEWENIUS},
            {"nister", Problem::NISTER},
            {"eightpt", Problem::EIGHTPT}};
        if (arguments.size() != 3 || algorithms.count(arguments[0]) == 0)
            throw std::runtime_error("arguments: stewenius|nister|eightpt ITERATIONS THRESHOLD");
        const Problem::algorithm_t algorithm = algorithms.at(arguments[0]);
        const int iterations = protocol::positive<int>(arguments[1], "ITERATIONS");
        const double threshold = protocol::positive<double>(arguments[2], "THRESHOLD");
        return [=](const protocol::Pair &pair) {
            return estimate(pair, algorithm, iterations, threshold);
        };
    });
}
