// A wrapper in C++17, and threads that share a handle. Usage: smoke DATA, the folder of golden files.

#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <random>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "csbrdf.h"

namespace {

struct Error : std::runtime_error {
    csbrdf_status status;

    explicit Error(csbrdf_status status) : std::runtime_error(message()), status(status) {}

    static std::string message() {
        std::string text(csbrdf_last_error(nullptr, 0), '\0');
        csbrdf_last_error(text.data(), text.size() + 1);
        return text;
    }
};

void check(csbrdf_status status) {
    if (status != CSBRDF_OK) throw Error(status);
}

/// A csbrdf file that is open as long as the object lives.
class Brdf {
public:
    explicit Brdf(const std::string &utf8_path, std::size_t cache_bytes = 0) {
        csbrdf_options options{};
        options.size = sizeof options;
        options.cache_bytes = cache_bytes;
        csbrdf_brdf *opened = nullptr;
        check(csbrdf_open_path_with(utf8_path.c_str(), &options, &opened));
        handle.reset(opened);
    }

    std::vector<float> decode() const {
        std::size_t size = 0;
        check(csbrdf_table_size(handle.get(), &size));
        std::vector<float> values(size);
        check(csbrdf_decode_all(handle.get(), values.data(), values.size()));
        return values;
    }

    std::array<float, 3> eval(const std::array<double, 3> &wi, const std::array<double, 3> &wo) const {
        std::array<float, 3> rgb{};
        check(csbrdf_eval(handle.get(), wi.data(), wo.data(), rgb.data(), rgb.size()));
        return rgb;
    }

private:
    struct Close {
        void operator()(csbrdf_brdf *brdf) const { csbrdf_close(brdf); }
    };
    std::unique_ptr<csbrdf_brdf, Close> handle;
};

using Pair = std::array<std::array<double, 3>, 2>;

std::vector<Pair> random_pairs(std::size_t count) {
    std::mt19937 random(7);
    auto direction = [&] {
        auto uniform = [&] { return random() / 4294967296.0; };
        const double z = uniform(), phi = 6.283185307179586 * uniform(), r = std::sqrt(1.0 - z * z);
        return std::array<double, 3>{r * std::cos(phi), r * std::sin(phi), z};
    };
    std::vector<Pair> pairs(count);
    for (Pair &pair : pairs) pair = {direction(), direction()};
    return pairs;
}

int run(const std::string &data) {
    constexpr int THREADS = 4;
    const std::string path = data + "/dct-dependent-grazing-zeros.csbrdf";
    const auto pairs = random_pairs(500);
    const Brdf alone(path);
    const auto table = alone.decode();
    std::vector<std::array<float, 3>> expected;
    for (const auto &[wi, wo] : pairs) expected.push_back(alone.eval(wi, wo));

    // With room for one block, threads drive each other's blocks out.
    for (const std::size_t cache_bytes : {std::size_t{0}, std::size_t{1}}) {
        const Brdf shared(path, cache_bytes);
        std::array<int, THREADS> wrong{};
        std::vector<std::thread> threads;
        for (int t = 0; t < THREADS; ++t) {
            threads.emplace_back([&, t] {
                try {
                    for (std::size_t n = 0; n < pairs.size(); ++n) {
                        const std::size_t i = (n + 125 * static_cast<std::size_t>(t)) % pairs.size();
                        wrong[t] += shared.eval(pairs[i][0], pairs[i][1]) != expected[i];
                    }
                    wrong[t] += shared.decode() != table;
                    // Each thread has a message of its own.
                    wrong[t] += csbrdf_last_error(nullptr, 0) != 0;
                    const std::string missing = data + "/missing " + std::to_string(t);
                    try {
                        Brdf none(missing);
                        ++wrong[t];
                    } catch (const Error &e) {
                        std::this_thread::yield();
                        wrong[t] += e.status != CSBRDF_IO || Error::message().find(missing) == std::string::npos;
                    }
                } catch (const std::exception &e) {
                    std::fprintf(stderr, "smoke.cpp: thread %d: %s\n", t, e.what());
                    ++wrong[t];
                }
            });
        }
        for (auto &thread : threads) thread.join();
        for (int t = 0; t < THREADS; ++t) {
            if (wrong[t] != 0) {
                std::fprintf(stderr, "smoke.cpp: thread %d differs %d times\n", t, wrong[t]);
                return 1;
            }
        }
    }
    if (csbrdf_last_error(nullptr, 0) != 0 || csbrdf_abi_version() != CSBRDF_ABI_VERSION) return 1;
    std::printf("smoke.cpp: csbrdf %s, %d threads agree with one on %zu pairs of directions and %zu values\n",
                csbrdf_version(), THREADS, pairs.size(), table.size());
    return 0;
}

} // namespace

int main(int argc, char **argv) {
    try {
        return run(argc > 1 ? argv[1] : "../../tests/data/v1");
    } catch (const std::exception &e) {
        std::fprintf(stderr, "smoke.cpp: %s\n", e.what());
        return 1;
    }
}
