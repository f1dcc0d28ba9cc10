// The distance of two meshes, in both directions. Uses no code of isonest.
//
// usage: isonest_mesh_distance A.ply B.ply [--min-component N] [--spacing S] [--epsilon E]
//                              [--stop-above X] [--threads T] [--max-only]
//
// Distances are from points of one mesh to the nearest point of the other's triangles, in the
// meshes' unit. The points are every vertex that a triangle uses, and ten in every triangle: its
// centroid, the midpoints of its edges, three towards its corners and three between. A triangle
// with an edge longer than S (default: three times the smaller mean edge length of the two meshes)
// is first cut into n * n congruent ones, which have ten points each. Mean and quantiles are those
// of the surface: every point is weighted with the area that it represents. Quantiles are rounded
// up by at most 0.03 %.
//
// "max" was found at a point ("at"). "max_at_most" is a bound: no point of the surface, sampled or
// not, is farther. Distance to a triangle is convex, so over a part of a triangle it is largest at
// the part's corners. Parts are quartered, the one with the largest bound first, until the bound is
// within E (default S / 1000) of what was found, or 20 million points were evaluated.
//
// --min-component first removes the components of fewer than N triangles from A, the full mesh (in
// a simplified mesh, few triangles do not indicate a speck). With --stop-above the program ends as
// soon as a vertex is farther than X and prints "stopped", and does not quarter parts that are
// nearer. With --max-only it omits the ten points, and so mean and quantiles; the bound is as good.
// Prints JSON; a distance is null if one of the meshes has no triangles. Memory: about 200 bytes
// per triangle.
#include <atomic>
#include <limits>
#include <queue>
#include <thread>
#include <tuple>

#include "tools/bench/meshes/triangle_tree.h"

using namespace bench;

namespace {

struct Options {
    double spacing = 0;
    double epsilon = 0;
    double stop_above = std::numeric_limits<double>::infinity();
    unsigned threads = 1;
    bool max_only = false;
};

struct Direction {
    double max = 0;
    Point at{};
    double max_at_most = 0;
    double mean = 0;
    double p99 = 0;
    double p999 = 0;
    std::size_t points = 0;
    bool sampled = false;  ///< mean and quantiles are known
    bool stopped = false;

    /// Among equal distances, keeps the first point by coordinates, so that the result does not
    /// depend on the threads.
    void take(double distance, const Point& p) {
        const bool is_first = std::tie(p[0], p[1], p[2]) < std::tie(at[0], at[1], at[2]);
        if (distance > max || (distance == max && max > 0 && is_first)) {
            max = distance;
            at = p;
        }
    }
};

/// Area over distance, in bins of 1/4096 of the distance.
class Histogram {
  public:
    void add(double distance, double area) {
        weights_[std::bit_cast<std::uint32_t>(static_cast<float>(distance)) >> kShift] += area;
        moment_ += distance * area;
    }
    void add(const Histogram& other) {
        std::transform(weights_.begin(), weights_.end(), other.weights_.begin(), weights_.begin(),
                       std::plus<>());
        moment_ += other.moment_;
    }
    double mean() const { return total() > 0 ? moment_ / total() : 0; }
    /// The upper end of the bin that contains the quantile.
    double quantile(double q) const {
        double rest = q * total();
        for (std::uint32_t i = 0; i < weights_.size(); ++i) {
            rest -= weights_[i];
            if (rest <= 0 && weights_[i] > 0) {
                return i == 0 ? 0.0 : std::bit_cast<float>((i + 1) << kShift);
            }
        }
        return 0;
    }

  private:
    static constexpr unsigned kShift = 11;
    double total() const { return std::accumulate(weights_.begin(), weights_.end(), 0.0); }
    std::vector<double> weights_ = std::vector<double>(std::size_t{1} << 20);
    double moment_ = 0;
};

/// Barycentric weights: the centroid, midpoints, towards the corners, between.
constexpr std::array<std::array<double, 3>, 10> kTen{{{1 / 3.0, 1 / 3.0, 1 / 3.0},
                                                      {0.5, 0.5, 0},
                                                      {0, 0.5, 0.5},
                                                      {0.5, 0, 0.5},
                                                      {4 / 6.0, 1 / 6.0, 1 / 6.0},
                                                      {1 / 6.0, 4 / 6.0, 1 / 6.0},
                                                      {1 / 6.0, 1 / 6.0, 4 / 6.0},
                                                      {2 / 12.0, 5 / 12.0, 5 / 12.0},
                                                      {5 / 12.0, 2 / 12.0, 5 / 12.0},
                                                      {5 / 12.0, 5 / 12.0, 2 / 12.0}}};

Point mix(const Corners& t, const std::array<double, 3>& w) {
    return w[0] * t[0] + w[1] * t[1] + w[2] * t[2];
}

/// Calls work(thread, first, last) for blocks of 0 .. n - 1.
template <typename Work>
void in_blocks(std::size_t n, unsigned threads, const Work& work) {
    constexpr std::size_t kBlock = 4096;
    std::atomic<std::size_t> next{0};
    std::vector<std::jthread> running;
    for (unsigned thread = 0; thread < threads; ++thread) {
        running.emplace_back([&, thread] {
            for (std::size_t first = next.fetch_add(kBlock); first < n;
                 first = next.fetch_add(kBlock)) {
                work(thread, first, std::min(n, first + kBlock));
            }
        });
    }
}

/// Measures the vertices that triangles use. Returns the nearest triangle of each.
std::vector<Tree::Nearest> ask_vertices(const Mesh& from, const Tree& to, const Options& options,
                                        Direction& found) {
    std::vector<char> used(from.points.size());
    for (const Triangle& t : from.triangles) {
        used[t[0]] = used[t[1]] = used[t[2]] = 1;
    }
    std::vector<Tree::Nearest> nearest(from.points.size());
    std::atomic<bool> stop{false};
    in_blocks(nearest.size(), options.threads, [&](unsigned, std::size_t first, std::size_t last) {
        std::uint32_t guess = 0;
        for (std::size_t i = first; i < last && !stop; ++i) {
            if (used[i] != 0) {
                nearest[i] = to.nearest(from.points[i], guess);
                guess = nearest[i].triangle;
                stop = stop || std::sqrt(nearest[i].squared) > options.stop_above;
            }
        }
    });
    for (std::size_t i = 0; i < nearest.size(); ++i) {
        if (used[i] != 0 && std::isfinite(nearest[i].squared)) {
            found.take(std::sqrt(nearest[i].squared), from.points[i]);
            ++found.points;
        }
    }
    found.stopped = stop;
    return nearest;
}

/// Measures ten points of every triangle, or of every part of it.
void ask_triangles(const Mesh& from, const Tree& to, const Options& options,
                   const std::vector<Tree::Nearest>& nearest, Direction& found) {
    std::vector<Histogram> areas(options.threads);
    std::vector<Direction> each(options.threads);
    in_blocks(
        from.triangles.size(), options.threads,
        [&](unsigned thread, std::size_t first, std::size_t last) {
            for (std::size_t i = first; i < last; ++i) {
                const Corners t = corners_of(from, i);
                const double longest =
                    std::max({length(t[1] - t[0]), length(t[2] - t[1]), length(t[0] - t[2])});
                const int n =
                    static_cast<int>(std::clamp(std::ceil(longest / options.spacing), 1.0, 1000.0));
                const double area = 0.5 * length(cross(t[1] - t[0], t[2] - t[0])) / (10.0 * n * n);
                std::uint32_t guess = nearest[from.triangles[i][0]].triangle;
                const auto ask = [&](const Point& p, double weight) {
                    const Tree::Nearest there = to.nearest(p, guess);
                    guess = there.triangle;
                    each[thread].take(std::sqrt(there.squared), p);
                    areas[thread].add(std::sqrt(there.squared), weight);
                    ++each[thread].points;
                };
                // Parts: the upright one at corner (x, y) and, if there is space, the inverted one
                // beside it.
                const auto at = [&](int x, int y) {
                    const double a = static_cast<double>(x) / n;
                    const double b = static_cast<double>(y) / n;
                    return mix(t, {1 - a - b, a, b});
                };
                for (int x = 0; x < n; ++x) {
                    for (int y = 0; x + y < n; ++y) {
                        for (int turned = 0; turned < (x + y + 1 < n ? 2 : 1); ++turned) {
                            const Corners part =
                                turned == 0 ? Corners{at(x, y), at(x + 1, y), at(x, y + 1)}
                                            : Corners{at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)};
                            for (const auto& weights : kTen) {
                                ask(mix(part, weights), area);
                            }
                        }
                    }
                }
            }
        });
    for (unsigned thread = 0; thread < options.threads; ++thread) {
        found.take(each[thread].max, each[thread].at);
        found.points += each[thread].points;
        if (thread > 0) {
            areas[0].add(areas[thread]);
        }
    }
    found.sampled = true;
    found.mean = areas[0].mean();
    found.p99 = areas[0].quantile(0.99);
    found.p999 = areas[0].quantile(0.999);
}

/// Raises found.max to within epsilon of the true maximum, and bounds it.
void bound_max(const Mesh& from, const Tree& to, const Options& options,
               const std::vector<Tree::Nearest>& nearest, Direction& found) {
    struct Part {
        double bound;
        Corners corners;
        std::array<Tree::Nearest, 3> nearest;
        bool operator<(const Part& other) const { return bound < other.bound; }
    };
    // A part is bounded in two ways: by the maximum distance of its corners to one triangle; and by
    // the maximum of their distances to any triangle plus the way to the nearest corner, which is
    // at most 1 / sqrt(3) of the longest side.
    const auto bound = [&](Part& part) {
        double best = std::numeric_limits<double>::infinity();
        for (const Tree::Nearest& candidate : part.nearest) {
            double worst = 0;
            for (const Point& p : part.corners) {
                worst = std::max(worst, to.squared(p, candidate.triangle));
            }
            best = std::min(best, worst);
        }
        double reach = 0;
        double corner = 0;
        for (std::size_t i = 0; i < 3; ++i) {
            reach = std::max(reach,
                             length(part.corners[i] - part.corners[(i + 1) % 3]) / std::sqrt(3.0));
            corner = std::max(corner, part.nearest[i].squared);
        }
        part.bound = std::min(std::sqrt(best), std::sqrt(corner) + reach);
    };
    const auto enough = [&] {
        return std::max(found.max + options.epsilon,
                        std::isfinite(options.stop_above) ? options.stop_above : 0);
    };
    std::priority_queue<Part> open;
    const auto consider = [&](Part part) {
        bound(part);
        if (part.bound > enough()) {
            open.push(part);
        } else {
            found.max_at_most = std::max(found.max_at_most, part.bound);
        }
    };
    for (std::size_t i = 0; i < from.triangles.size(); ++i) {
        const Triangle& t = from.triangles[i];
        consider({0, corners_of(from, i), {nearest[t[0]], nearest[t[1]], nearest[t[2]]}});
    }
    for (int asked = 0; !open.empty() && open.top().bound > enough() && asked < 20'000'000;
         asked += 3) {
        const Part part = open.top();
        open.pop();
        Corners middle;
        std::array<Tree::Nearest, 3> there;
        for (std::size_t i = 0; i < 3; ++i) {
            middle[i] = 0.5 * (part.corners[i] + part.corners[(i + 1) % 3]);
            there[i] = to.nearest(middle[i], part.nearest[i].triangle);
            found.take(std::sqrt(there[i].squared), middle[i]);
        }
        found.points += 3;
        for (std::size_t i = 0; i < 3; ++i) {
            consider({0,
                      {part.corners[i], middle[i], middle[(i + 2) % 3]},
                      {part.nearest[i], there[i], there[(i + 2) % 3]}});
        }
        consider({0, middle, there});
    }
    found.max_at_most =
        std::max({found.max_at_most, found.max, open.empty() ? 0.0 : open.top().bound});
}

Direction measure(const Mesh& from, const Tree& to, const Options& options) {
    Direction found;
    const std::vector<Tree::Nearest> nearest = ask_vertices(from, to, options, found);
    if (!found.stopped) {
        if (!options.max_only) {
            ask_triangles(from, to, options, nearest, found);
        }
        bound_max(from, to, options, nearest, found);
    }
    return found;
}

double mean_edge(const Mesh& mesh) {
    double sum = 0;
    for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
        const Corners t = corners_of(mesh, i);
        sum += length(t[1] - t[0]) + length(t[2] - t[1]) + length(t[0] - t[2]);
    }
    return sum / (3.0 * static_cast<double>(mesh.triangles.size()));
}

void print(const char* name, const Direction& d) {
    std::printf("\"%s\": {\"max\": %.9g, \"max_at_most\": %.9g, \"at\": [%.9g, %.9g, %.9g], ", name,
                d.max, d.max_at_most, d.at[0], d.at[1], d.at[2]);
    if (d.sampled) {
        std::printf("\"mean\": %.6g, \"p99\": %.6g, \"p99.9\": %.6g, ", d.mean, d.p99, d.p999);
    }
    std::printf("\"points\": %zu}", d.points);
}

int run(std::span<char*> arguments) {
    constexpr const char* kUsage =
        "usage: isonest_mesh_distance A.ply B.ply [--min-component N] [--spacing S] [--epsilon E] "
        "[--stop-above X] [--threads T] [--max-only]";
    std::vector<std::string> files;
    Options options{.threads = std::max(1U, std::thread::hardware_concurrency())};
    std::size_t least = 0;
    for (std::size_t i = 1; i < arguments.size(); ++i) {
        const std::string word = arguments[i];
        if (!word.starts_with("--")) {
            files.push_back(word);
            continue;
        }
        options.max_only = options.max_only || word == "--max-only";
        if (word == "--max-only") {
            continue;
        }
        if (++i == arguments.size()) {
            throw std::runtime_error(kUsage);
        }
        const double value = std::stod(arguments[i]);
        if (word == "--min-component") {
            least = static_cast<std::size_t>(value);
        } else if (word == "--spacing") {
            options.spacing = value;
        } else if (word == "--epsilon") {
            options.epsilon = value;
        } else if (word == "--stop-above") {
            options.stop_above = value;
        } else if (word == "--threads") {
            options.threads = std::max(1U, static_cast<unsigned>(value));
        } else {
            throw std::runtime_error(kUsage);
        }
    }
    if (files.size() != 2) {
        throw std::runtime_error(kUsage);
    }
    std::array<Mesh, 2> meshes{read_ply(files[0]), read_ply(files[1])};
    drop_small_components(meshes[0], least);
    std::printf("{\"triangles\": [%zu, %zu], ", meshes[0].triangles.size(),
                meshes[1].triangles.size());
    if (meshes[0].triangles.empty() || meshes[1].triangles.empty()) {
        std::printf("\"max\": null, \"max_at_most\": null, \"p99.9\": null, \"stopped\": false}\n");
        return 0;
    }
    if (options.spacing <= 0) {
        options.spacing = 3 * std::min(mean_edge(meshes[0]), mean_edge(meshes[1]));
    }
    options.epsilon = options.epsilon > 0 ? options.epsilon : options.spacing / 1000;
    const Direction forth = measure(meshes[0], Tree(meshes[1]), options);
    const Direction back = forth.stopped ? forth : measure(meshes[1], Tree(meshes[0]), options);
    std::printf("\"max\": %.9g, ", std::max(forth.max, back.max));
    if (forth.stopped || back.stopped) {
        std::printf("\"stopped\": true}\n");
        return 0;
    }
    std::printf("\"max_at_most\": %.9g, \"stopped\": false, ",
                std::max(forth.max_at_most, back.max_at_most));
    if (forth.sampled) {
        std::printf("\"p99.9\": %.6g, ", std::max(forth.p999, back.p999));
    }
    print("a_to_b", forth);
    std::printf(", ");
    print("b_to_a", back);
    std::printf("}\n");
    return 0;
}

}  // namespace

int main(int argc, char** argv) {
    try {
        return run({argv, static_cast<std::size_t>(argc)});
    } catch (const std::exception& error) {
        std::fprintf(stderr, "isonest_mesh_distance: %s\n", error.what());
        return 1;
    }
}
