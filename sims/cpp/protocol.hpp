// What both programs speak. In: a line "pairs n", then float64 (pairs, n, 4), azimuth and elevation
// in the left and in the right view. Out: float64 (pairs, 3), heading_l, heading_r, microseconds.
// Angles in radians, in a robot's frame (x forward, y left, z up); NaN headings stand for a
// failure.
#pragma once

#include <cmath>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <exception>
#include <iostream>
#include <iterator>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

namespace protocol {

struct Correspondence {
    double azimuth_l, elevation_l, azimuth_r, elevation_r;
};
using Pair = std::vector<Correspondence>;

struct Headings {
    double l = std::numeric_limits<double>::quiet_NaN();
    double r = std::numeric_limits<double>::quiet_NaN();
};

// Read all pairs before any is answered, so that truncated input gives no answers at all.
inline std::vector<Pair> read_pairs(std::istream &in) {
    std::string header;
    std::getline(in, header);
    std::istringstream words(header);
    long long pairs = -1, count = -1;
    if (!(words >> pairs >> count) || !(words >> std::ws).eof() || pairs < 0 || count < 1)
        throw std::runtime_error("the first line must be \"pairs n\", two numbers");

    const std::string body{std::istreambuf_iterator<char>(in), {}};
    const long long found = body.size() / sizeof(Correspondence);
    // both factors are checked first: a huge header must not overflow the product
    const bool complete = body.size() % sizeof(Correspondence) == 0 && pairs <= found &&
                          (pairs == 0 || count <= found) && pairs * count == found;
    if (!complete)
        throw std::runtime_error("expected " + std::to_string(pairs) + " x " +
                                 std::to_string(count) + " x 4 float64, got " +
                                 std::to_string(body.size()) + " bytes");

    std::vector<Pair> all(pairs, Pair(count));
    for (long long k = 0; k < pairs; ++k)
        std::memcpy(all[k].data(), body.data() + k * count * sizeof(Correspondence),
                    count * sizeof(Correspondence));
    return all;
}

inline double microseconds() {
    timespec time;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
    return 1e6 * time.tv_sec + 1e-3 * time.tv_nsec;
}

// Give the positive number that an argument is; `what` names it to whoever got it wrong.
template <typename Number> Number positive(const std::string &word, const std::string &what) {
    std::istringstream in(word);
    Number value{};
    if (!(in >> value) || !in.eof() || !(value > 0))
        throw std::runtime_error(what + " must be a positive number, not \"" + word + "\"");
    return value;
}

// Answer all of standard input by what `make(arguments)` gives: a function of a Pair to Headings.
template <typename Make> int serve(int argc, char **argv, Make make) {
    try {
        const auto estimate = make(std::vector<std::string>(argv + 1, argv + argc));
        std::vector<double> answers;
        for (const Pair &pair : read_pairs(std::cin)) {
            const double start = microseconds();
            const Headings found = estimate(pair);
            const double spent = microseconds() - start;
            answers.insert(answers.end(), {found.l, found.r, spent});
        }
        std::cout.write(reinterpret_cast<const char *>(answers.data()),
                        answers.size() * sizeof(double));
        if (!std::cout.flush())
            throw std::runtime_error("standard output cannot be written");
        return 0;
    } catch (const std::exception &error) {
        std::cerr << argv[0] << ": " << error.what() << '\n';
        return 2;
    }
}

} // namespace protocol
