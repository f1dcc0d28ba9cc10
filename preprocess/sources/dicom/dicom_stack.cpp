#include "preprocess/sources/dicom/dicom_stack.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <string_view>
#include <tuple>

#include <isonest/error.h>

#include "store/base/vectors.h"

namespace isonest::detail {
namespace {

Double3 minus(const Double3& a, const Double3& b) {
    return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}

/// The effect of a tilted gantry on a stack.
struct DicomTilt {
    /// Between the direction from slice to slice and the normal of the slices.
    double degrees = 0;
    double distance = 0;  ///< of neighbouring slices along the normal
    double shift = 0;     ///< of the last slice relative to the first, in their planes
};

DicomTilt tilt_of(const DicomStack& stack) {
    const Double3& step = stack.steps[2];
    const Double3& n = stack.normal;
    DicomTilt tilt;
    tilt.distance = step[0] * n[0] + step[1] * n[1] + step[2] * n[2];
    const Double3 aside =
        minus(step, {n[0] * tilt.distance, n[1] * tilt.distance, n[2] * tilt.distance});
    const double shift = std::hypot(aside[0], aside[1], aside[2]);
    constexpr double kDegrees = 180 / std::numbers::pi;
    tilt.degrees = std::atan2(shift, std::fabs(tilt.distance)) * kDegrees;
    tilt.shift = shift * static_cast<double>(stack.count - 1);
    return tilt;
}

}  // namespace

PlacedStack place_stack(const Int3& nodes, const DicomStack& stack, bool spaced,
                        const std::string& name) {
    PlacedStack result;
    const DicomTilt tilt = stack.placed ? tilt_of(stack) : DicomTilt{};
    const Double3 spacing{std::hypot(stack.steps[0][0], stack.steps[0][1], stack.steps[0][2]),
                          std::hypot(stack.steps[1][0], stack.steps[1][1], stack.steps[1][2]),
                          std::fabs(tilt.distance)};
    constexpr double kMaxShift = 0.1;  // in voxels, as in place_in_world()
    const bool tilted =
        stack.placed && tilt.shift >= kMaxShift * std::min({spacing[0], spacing[1], spacing[2]});
    result.frame = stack.placed ? AnatomicalFrame::lps : AnatomicalFrame::unknown;
    if (!(spaced && tilted)) {
        try {
            result.place = place_in_world(nodes, stack.steps, stack.first, name);
            return result;
        } catch (const Error&) {
            if (!spaced) {
                throw;
            }
        }
    }
    // The axes are treated as the world's, which is only correct for the patient if they already
    // were.
    result.place.origin = stack.first;
    const std::array<Double3, 3> axes{stack.steps[0], stack.steps[1], stack.normal};
    for (std::size_t a = 0; a < 3; ++a) {
        const Double3& v = axes.at(a);
        if (!(v.at(a) > (1 - 1e-6) * std::hypot(v[0], v[1], v[2]))) {
            result.frame = AnatomicalFrame::unknown;
        }
    }
    if (tilted) {
        result.notes.push_back(fmt::format(
            "the tilt of the slices by {:.1f} degrees is dropped{}; the last slice is then {:.4g} "
            "away from its true position; the file's spacing is {:.6g},{:.6g},{:.6g}",
            tilt.degrees,
            result.frame == AnatomicalFrame::lps ? "" : ", and so are the directions of the axes",
            tilt.shift, spacing[0], spacing[1], spacing[2]));
    }
    return result;
}

namespace {

constexpr double kMaxShift = 0.1;    ///< in voxels
constexpr double kSamePlace = 1e-3;  ///< in pixels
constexpr std::size_t kMaxListed = 10;

using Slices = std::vector<DicomSlice>;

class Stacking {
  public:
    Stacking(const DicomGroup& series, const std::vector<std::filesystem::path>& files,
             bool as_it_is, const std::string& name)
        : series_(series), files_(files), as_it_is_(as_it_is), name_(name) {}

    DicomStack run() {
        stack_.slices = series_.slices;
        const bool placed = series_.orientation && series_.spacing &&
                            std::all_of(stack_.slices.begin(), stack_.slices.end(),
                                        [](const DicomSlice& s) { return s.position.has_value(); });
        stack_.placed = placed;
        if (placed) {
            by_position();
            stack_.normal = normal_;
        } else {
            by_number();
        }
        return std::move(stack_);
    }

  private:
    [[noreturn]] void refuse(const std::string& problem, std::vector<Remedy> remedies = {}) const {
        throw Error(ErrorKind::unsupported, {name_}, problem, std::move(remedies));
    }
    [[nodiscard]] std::string text(const DicomSlice& slice) const {
        const std::string file = files_[slice.file].string();
        const bool frames = std::any_of(stack_.slices.begin(), stack_.slices.end(),
                                        [](const DicomSlice& s) { return s.frame > 0; });
        return frames ? fmt::format("{} (frame {})", file, slice.frame + 1) : file;
    }
    [[nodiscard]] double along(const DicomSlice& slice) const {
        return dot(*slice.position, normal_);
    }

    void by_position() {
        const auto& [row, column] = *series_.orientation;
        normal_ = {row[1] * column[2] - row[2] * column[1], row[2] * column[0] - row[0] * column[2],
                   row[0] * column[1] - row[1] * column[0]};
        const double length = std::sqrt(dot(normal_, normal_));
        if (!(length > 0.5)) {
            refuse("rows and columns run in one direction (ImageOrientationPatient)");
        }
        for (double& v : normal_) {
            v /= length;
        }
        std::stable_sort(
            stack_.slices.begin(), stack_.slices.end(),
            [&](const DicomSlice& a, const DicomSlice& b) { return along(a) < along(b); });
        group_by_place();
        const Slices& s = stack_.slices;
        const auto last = static_cast<std::size_t>(stack_.count - 1);
        for (std::size_t a = 0; a < 3; ++a) {
            stack_.steps[0].at(a) = row.at(a) * (*series_.spacing)[0];
            stack_.steps[1].at(a) = column.at(a) * (*series_.spacing)[1];
            stack_.steps[2].at(a) = last > 0 ? (s[last].position->at(a) - s[0].position->at(a)) /
                                                   static_cast<double>(last)
                                             : normal_.at(a) * series_.step.value_or(1);
        }
        stack_.first = *s[0].position;
        check_distances();
    }

    /// Images at the same place belong to different times.
    void group_by_place() {
        Slices& s = stack_.slices;
        const double same = kSamePlace * std::min((*series_.spacing)[0], (*series_.spacing)[1]);
        std::vector<std::size_t> starts;
        for (std::size_t i = 0; i < s.size(); ++i) {
            if (i == 0 || along(s[i]) - along(s[i - 1]) > same) {
                starts.push_back(i);
            }
        }
        // For each number of images, at how many places it occurs.
        std::map<std::size_t, std::size_t> sizes;
        const auto size_at = [&](std::size_t g) {
            return (g + 1 < starts.size() ? starts[g + 1] : s.size()) - starts[g];
        };
        for (std::size_t g = 0; g < starts.size(); ++g) {
            ++sizes[size_at(g)];
        }
        const std::size_t usual =
            std::max_element(sizes.begin(), sizes.end(), [](const auto& a, const auto& b) {
                return a.second < b.second;
            })->first;
        const auto parts = ordering_parts(starts, usual);
        std::vector<std::string> wrong;
        for (std::size_t g = 0; g < starts.size(); ++g) {
            const auto begin = s.begin() + static_cast<std::ptrdiff_t>(starts[g]);
            const auto end = begin + static_cast<std::ptrdiff_t>(size_at(g));
            std::stable_sort(begin, end, [&](const DicomSlice& a, const DicomSlice& b) {
                for (const std::size_t part : parts) {
                    if (a.moment.at(part) != b.moment.at(part)) {
                        return a.moment.at(part) < b.moment.at(part);
                    }
                }
                return std::make_tuple(a.number.value_or(0), a.file, a.frame) <
                       std::make_tuple(b.number.value_or(0), b.file, b.frame);
            });
            const auto copy = std::adjacent_find(
                begin, end,
                [](const DicomSlice& a, const DicomSlice& b) { return a.instance == b.instance; });
            if (copy != end || size_at(g) != usual) {
                const auto& other = copy != end ? *std::next(copy) : *std::prev(end);
                wrong.push_back(
                    size_at(g) == 1
                        ? fmt::format("{} is the only image at its position", text(*begin))
                        : fmt::format("{} and {} have the same position",
                                      text(copy != end ? *copy : *begin), text(other)));
            }
        }
        if (!wrong.empty()) {
            refuse("there are duplicate slices: " + list(wrong));
        }
        check_times(starts, usual);
        if (usual > 1) {
            stack_.times_are = text_of_times(parts, usual);
        }
        stack_.times = static_cast<std::int64_t>(usual);
        stack_.count = static_cast<std::int64_t>(starts.size());
        Slices sorted(s.size());
        for (std::size_t g = 0; g < starts.size(); ++g) {
            for (std::size_t t = 0; t < usual; ++t) {
                sorted[t * starts.size() + g] = s[starts[g] + t];
            }
        }
        s = std::move(sorted);
    }

    /// The parts that can distinguish the images at a place: the time, and those with the same
    /// values at all places. If the number of images differs, that is reported separately.
    [[nodiscard]] std::vector<std::size_t> ordering_parts(const std::vector<std::size_t>& starts,
                                                          std::size_t times) const {
        const Slices& s = stack_.slices;
        std::vector<std::size_t> parts;
        for (std::size_t part = 0; part < kDicomMomentParts; ++part) {
            std::vector<double> first;
            bool same = s.size() == starts.size() * times;
            for (std::size_t g = 0; same && g < starts.size(); ++g) {
                std::vector<double> values;
                for (std::size_t i = starts[g]; i < starts[g] + times; ++i) {
                    same = same && i < s.size();
                    values.push_back(same ? s[i].moment.at(part) : 0);
                }
                std::sort(values.begin(), values.end());
                first = g == 0 ? values : first;
                same = same && values == first;
            }
            if (part == static_cast<std::size_t>(DicomMomentPart::time) ||
                (same && times > 1 && first.front() != first.back())) {
                parts.push_back(part);
            }
        }
        return parts;
    }

    /// The values of the slices at the first place, which are sorted: "echo 1, 2, 3".
    [[nodiscard]] std::string text_of_times(const std::vector<std::size_t>& parts,
                                            std::size_t times) const {
        constexpr std::array<std::string_view, kDicomMomentParts> kNames{
            "temporal position", "acquisition", "b value", "trigger time", "echo"};
        constexpr std::size_t kMax = 8;
        std::string text;
        for (const std::size_t part : parts) {
            const auto value = [&](std::size_t i) { return stack_.slices[i].moment.at(part); };
            bool differ = false;
            std::string values;
            for (std::size_t i = 0; i < times; ++i) {
                differ = differ || value(i) != value(0);
                if (i < kMax) {
                    values += fmt::format("{}{:g}", i == 0 ? "" : ", ", value(i));
                }
            }
            if (differ) {
                text += fmt::format("{}{} {}{}", text.empty() ? "" : "; ", kNames.at(part), values,
                                    times > kMax ? ", ..." : "");
            }
        }
        return text.empty() ? "the order of the image numbers" : text;
    }

    /// Images at one position along the normal may lie beside each other: tiles, or a patient who
    /// moved.
    void check_times(const std::vector<std::size_t>& starts, std::size_t times) {
        const Slices& s = stack_.slices;
        for (const std::size_t start : starts) {
            for (std::size_t i = start + 1; i < start + times; ++i) {
                const Double3& a = *s[start].position;
                const Double3& b = *s[i].position;
                const double aside = std::hypot(b[0] - a[0], b[1] - a[1], b[2] - a[2]);
                if (aside > kMaxShift * std::min((*series_.spacing)[0], (*series_.spacing)[1])) {
                    report(fmt::format("{} is shifted by {:.3g} from {}, in the same plane",
                                       text(s[i]), aside, text(s[start])));
                    return;
                }
            }
        }
    }

    void check_distances() {
        const Slices& s = stack_.slices;
        const auto count = static_cast<std::size_t>(stack_.count);
        if (count < 3) {
            return;
        }
        std::vector<double> gaps;
        for (std::size_t i = 1; i < count; ++i) {
            gaps.push_back(along(s[i]) - along(s[i - 1]));
        }
        std::vector<double> sorted = gaps;
        std::nth_element(sorted.begin(),
                         sorted.begin() + static_cast<std::ptrdiff_t>(count / 2 - 1), sorted.end());
        const double usual = sorted[count / 2 - 1];
        std::vector<std::string> missing;
        std::vector<std::string> uneven;
        for (std::size_t i = 0; i < gaps.size(); ++i) {
            const double more = std::round(gaps[i] / usual) - 1;
            if (std::fabs(gaps[i] - (more + 1) * usual) > 2 * kMaxShift * usual || more < 0) {
                uneven.push_back(
                    fmt::format("{:.6g} from {} to {}", gaps[i], text(s[i]), text(s[i + 1])));
            } else if (more > 0) {
                missing.push_back(
                    fmt::format("{} between {} and {}", more, text(s[i]), text(s[i + 1])));
            }
        }
        if (missing.empty() && uneven.empty()) {
            check_line();
            return;
        }
        const std::string distances = fmt::format(
            "the slices are not evenly spaced by {:.6g}; the distances that differ are: {}", usual,
            list(uneven));
        if (!missing.empty()) {
            report(fmt::format("slices are missing: {}", list(missing)));
        } else {
            place_unevenly(distances);
        }
    }

    /// Slices at uneven distances must not be shifted in their planes as well.
    void place_unevenly(const std::string& distances) {
        if (as_it_is_) {
            return report(distances);
        }
        stack_.notes.push_back(distances);
        for (std::size_t i = 0; i < static_cast<std::size_t>(stack_.count); ++i) {
            Double3 beside = *stack_.slices[i].position;
            for (std::size_t a = 0; a < 3; ++a) {
                beside.at(a) -= stack_.first.at(a);
            }
            const double forth = dot(beside, normal_);
            stack_.offsets.push_back(forth);
            const double aside = std::sqrt(std::max(dot(beside, beside) - forth * forth, 0.0));
            if (aside > kMaxShift * std::min((*series_.spacing)[0], (*series_.spacing)[1])) {
                refuse(fmt::format("{} is shifted by {:.3g} in its plane, and {}",
                                   text(stack_.slices[i]), aside, distances),
                       {{RemedyKind::place_in_world, "spacing"}});
            }
        }
    }

    /// Checks the sum of small differences.
    void check_line() {
        const Double3& step = stack_.steps[2];
        const double length = std::sqrt(dot(step, step));
        for (std::size_t i = 0; i < static_cast<std::size_t>(stack_.count); ++i) {
            Double3 beside = *stack_.slices[i].position;
            for (std::size_t a = 0; a < 3; ++a) {
                beside.at(a) -= stack_.first.at(a) + static_cast<double>(i) * step.at(a);
            }
            const double shift = std::sqrt(dot(beside, beside));
            const double forth = std::fabs(dot(beside, normal_));
            const double aside = std::sqrt(std::max(shift * shift - forth * forth, 0.0));
            const bool is_aside =
                aside > kMaxShift * std::min((*series_.spacing)[0], (*series_.spacing)[1]);
            if (is_aside || forth > kMaxShift * length) {
                const std::string off = fmt::format(
                    "{} is {:.3g} away from its position on the line from the first to the last "
                    "slice",
                    text(stack_.slices[i]), shift);
                return is_aside ? report(off) : place_unevenly(off);
            }
        }
    }

    void report(const std::string& problem) {
        if (!as_it_is_) {
            refuse(problem, {{RemedyKind::place_in_world, "spacing"}});
        }
        stack_.notes.push_back(problem);
    }

    void by_number() {
        Slices& s = stack_.slices;
        std::vector<std::int64_t> numbers;
        for (const DicomSlice& slice : s) {
            if (slice.number && slice.frame == 0) {
                numbers.push_back(*slice.number);
            }
        }
        const auto files = static_cast<std::size_t>(
            std::count_if(s.begin(), s.end(), [](const DicomSlice& a) { return a.frame == 0; }));
        std::sort(numbers.begin(), numbers.end());
        const bool numbered = numbers.size() == files &&
                              std::adjacent_find(numbers.begin(), numbers.end()) == numbers.end();
        if (numbered) {
            std::stable_sort(s.begin(), s.end(), [](const DicomSlice& a, const DicomSlice& b) {
                return std::make_pair(*a.number, a.frame) < std::make_pair(*b.number, b.frame);
            });
        }
        if (s.size() > 1) {
            stack_.notes.push_back(
                fmt::format("the images have no positions; they are sorted by {}",
                            numbered ? "image number" : "file name"));
        }
        stack_.count = static_cast<std::int64_t>(s.size());
        const std::array<double, 2> spacing = series_.spacing.value_or(std::array{1.0, 1.0});
        stack_.steps = {Double3{spacing[0], 0, 0}, Double3{0, spacing[1], 0},
                        Double3{0, 0, series_.step.value_or(1)}};
    }

    static std::string list(const std::vector<std::string>& places) {
        std::string text;
        for (std::size_t i = 0; i < places.size() && i < kMaxListed; ++i) {
            text += "\n  " + places[i];
        }
        if (places.size() > kMaxListed) {
            text += fmt::format("\n  and {} more", places.size() - kMaxListed);
        }
        return text;
    }

    const DicomGroup& series_;
    const std::vector<std::filesystem::path>& files_;
    bool as_it_is_;
    const std::string& name_;
    Double3 normal_{};
    DicomStack stack_;
};

}  // namespace

DicomStack stack_slices(const DicomGroup& images, const std::vector<std::filesystem::path>& files,
                        bool as_it_is, const std::string& name) {
    return Stacking(images, files, as_it_is, name).run();
}

}  // namespace isonest::detail
