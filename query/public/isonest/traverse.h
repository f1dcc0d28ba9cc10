// AdaptTraverse with functions of the caller: the recursive traversal of nested elements. It visits
// the elements of interest, stops where the error is small, and stores no element.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 2:
//
//     AdaptTraverse(T):
//         if SimplexIsOfInterest(T):
//             if T is of the finest grid, or eta(x_ref(T)) < epsilon:    the stop test
//                 SimplexAction(T)
//             else:
//                 bisect T at x_ref(T) into T1 and T2
//                 AdaptTraverse(T1)
//                 AdaptTraverse(T2)
//
// As a call: adapt_traverse<3>(store, interest, stop, action), or for_each_leaf<3>(store, stop,
// action) for the whole domain.
#pragma once

#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

#include <isonest/element.h>
#include <isonest/field.h>
#include <isonest/int3.h>
#include <isonest/progress.h>
#include <isonest/stop.h>
#include <isonest/store.h>
#include <isonest/world.h>

namespace isonest {

namespace detail {

/// Source of the numbers at nodes: U at node p of the lattice of `level` or a coarser one, and a
/// field at a refinement node, both by coordinates of the finest lattice. May cache; one per
/// thread.
template <class Numbers>
concept NodeNumbers = requires(Numbers& numbers, const Int3& p, int level, Field field) {
    { numbers.value(p, level) } -> std::same_as<double>;
    { numbers.indicator(p, field) } -> std::same_as<double>;
};

/// Selects the elements that exist for the traversal; those outside are not visited. The children
/// of an element that is inside are inside too, and are not asked for.
template <class Region, class T>
concept RegionOf = requires(const Region& region, const T& t) {
    { region.overlap(t) } -> std::same_as<Overlap>;
};

/// SimplexIsOfInterest. `field()`: the field that the test needs at the refinement node; nothing if
/// it needs none. may_hold(t, number, numbers): `number` is that field's value, 0 if there is none
/// and at the finest level. The test may read more from `numbers`: other fields or, for elements
/// that do not store the values of U, U at their corners.
template <class Test, class T, class Numbers>
concept InterestTest = requires(const Test& test, const T& t, double number, Numbers& numbers) {
    { test.field() } -> std::same_as<std::optional<Field>>;
    { test.may_hold(t, number, numbers) } -> std::same_as<bool>;
};

/// The stop test, for elements that are not of the finest level. `field()` and `numbers`: as above.
/// stops(t, eta, numbers) must be the same for all elements with the same refinement node.
template <class Test, class T, class Numbers>
concept IsStopTest = requires(const Test& test, const T& t, double eta, Numbers& numbers) {
    { test.field() } -> std::same_as<std::optional<Field>>;
    { test.stops(t, eta, numbers) } -> std::same_as<bool>;
};

/// SimplexAction. action(leaf, eta, where): `eta` is the number of the stop test's field, 0 at the
/// finest level or if it has none; `where` is the leaf's position relative to the region.
template <class Action, class T>
concept SimplexAction = requires(Action& action, const T& leaf, double eta, Overlap where) {
    action(leaf, eta, where);
};

/// Statistics of a traversal.
struct VisitCounts {
    std::uint64_t visited = 0;   ///< elements tested by SimplexIsOfInterest
    std::uint64_t leaves = 0;    ///< elements passed to SimplexAction
    std::uint64_t finished = 0;  ///< sum of size() of all elements that are finished

    void add(const VisitCounts& other) {
        visited += other.visited;
        leaves += other.leaves;
        finished += other.finished;
    }
};

/// The recursion at the top of this file, for elements of any type T. Both tests are stateless
/// functions of the element and of numbers of its refinement node, so all elements around a node
/// stop together, and a saturated field gives a mesh without hanging nodes. Leaves are passed to
/// the action, which makes no decisions. Children are visited in the order of T::for_each_child().
/// One instance per thread.
template <class T, NodeNumbers Numbers, RegionOf<T> Region, InterestTest<T, Numbers> Interest,
          IsStopTest<T, Numbers> Stop>
class AdaptTraverse {
  public:
    AdaptTraverse(Numbers& numbers, const Region& region, const Interest& interest,
                  const Stop& stop)
        : numbers_(numbers), region_(region), interest_(interest), stop_(stop) {}

    /// The coarsest elements of a lattice, with their values.
    template <class Lattice>
    [[nodiscard]] std::vector<T> roots(const Lattice& lattice) {
        return coarsest_of(lattice, numbers_, std::type_identity<T>());
    }
    /// AdaptTraverse(t).
    void subtree(const T& t, SimplexAction<T> auto& action) {
        visit(t, Overlap::crossing, action, nullptr);
    }
    /// The same, but only down to whole elements of `level`; those are added to `left`, unvisited.
    void above(const T& t, int level, SimplexAction<T> auto& action, std::vector<T>& left) {
        level_of_left_ = level;
        visit(t, Overlap::crossing, action, &left);
    }
    [[nodiscard]] const VisitCounts& counts() const { return counts_; }

  private:
    /// `parent`: the position of an element that contains this one.
    void visit(const T& t, Overlap parent, SimplexAction<T> auto& action, std::vector<T>* left) {
        if (left != nullptr && t.level == level_of_left_ && t.is_whole()) {
            left->push_back(t);
            return;
        }
        const Overlap where = parent == Overlap::inside ? parent : region_.overlap(t);
        if (where == Overlap::outside) {
            counts_.finished += t.size();
            return;
        }
        ++counts_.visited;
        const bool finest = t.level == 0;
        const std::optional<Field> asked = finest ? std::nullopt : interest_.field();
        const double number = asked ? numbers_.indicator(t.ref_node(), *asked) : 0;
        if (!interest_.may_hold(t, number, numbers_)) {
            counts_.finished += t.size();
            return;
        }
        double eta = 0;
        bool is_leaf = finest;
        if (!finest) {
            if (const std::optional<Field> field = stop_.field()) {
                eta = field == asked ? number : numbers_.indicator(t.ref_node(), *field);
            }
            is_leaf = stop_.stops(t, eta, numbers_);
        }
        if (is_leaf) {
            ++counts_.leaves;
            counts_.finished += t.size();
            action(t, eta, where);
            return;
        }
        t.for_each_child(numbers_, [&](const T& child) { visit(child, where, action, left); });
    }

    Numbers& numbers_;
    Region region_;
    Interest interest_;
    Stop stop_;
    VisitCounts counts_;
    int level_of_left_ = 0;
};

class StoreNodeReader;

/// NodeNumbers of a store, for one thread. Fields may be of any choice; up to kFields at a time are
/// read without loss of speed.
class StoreNodes {
  public:
    static constexpr std::size_t kFields = 2;

    explicit StoreNodes(std::unique_ptr<StoreNodeReader> reader);
    StoreNodes(StoreNodes&&) noexcept;
    StoreNodes& operator=(StoreNodes&&) noexcept;
    ~StoreNodes();

    [[nodiscard]] double value(const Int3& p, int level);
    /// Throws Error{not_found} if the store lacks the field, Error{invalid_argument} if it has no
    /// number for each node.
    [[nodiscard]] double indicator(const Int3& x, Field field);

  private:
    std::unique_ptr<StoreNodeReader> reader_;
};

/// RegionOf: a box, in coordinates of the finest lattice, infinite along flat axes.
struct LatticeRegion {
    Double3 lo{};
    Double3 hi{};

    template <class T>
    [[nodiscard]] Overlap overlap(const T& t) const {
        const auto [low, high] = t.bounds();
        return overlap_of(lo, hi, low, high);
    }
};

}  // namespace detail

/// The indicators at an element's refinement node, as passed to tests and actions. Valid during the
/// call.
class Indicators {
  public:
    template <int D>
    Indicators(detail::StoreNodes& nodes, const Element<D>& t)
        : nodes_(nodes), finest_(t.level == 0), begin_(t.v[0]), end_(t.v[t.ref_end()]) {}

    /// The field at the refinement node, read from the store; 0 for elements of the finest grid,
    /// which have none. Throws Error{not_found} if the store lacks the field,
    /// Error{invalid_argument} for `values` and for fields of cells.
    [[nodiscard]] double operator()(Field field) const {
        if (finest_) {
            return 0;
        }
        const Int3 twice = begin_ + end_;
        return nodes_.indicator({twice.x / 2, twice.y / 2, twice.z / 2}, field);
    }

  private:
    detail::StoreNodes& nodes_;
    bool finest_;
    const Int3& begin_;  ///< the ends of the refinement edge
    const Int3& end_;
};

/// Where a store's nodes lie in the world, whatever its axes: rotated, sheared, flat.
class Placement {
  public:
    explicit Placement(const Store& store);

    /// The position of a node of the finest lattice, in world units.
    [[nodiscard]] Double3 operator()(const Int3& node) const {
        Double3 p = origin_;
        for (int axis = 0; axis < 3; ++axis) {
            const auto a = static_cast<std::size_t>(axis);
            const double steps =
                uneven_ ? even_steps(a, node[axis]) : static_cast<double>(node[axis]);
            for (std::size_t w = 0; w < 3; ++w) {
                p[w] += step_[a][w] * steps;
            }
        }
        return p;
    }
    /// The positions of an element's vertices.
    template <int D>
    [[nodiscard]] std::array<Double3, D + 1> operator()(const Element<D>& t) const {
        std::array<Double3, D + 1> corners;
        for (std::size_t i = 0; i < corners.size(); ++i) {
            corners[i] = (*this)(t.v[i]);
        }
        return corners;
    }
    /// The length, area or volume of an element of the store, in world units.
    template <int D>
    [[nodiscard]] double size(const Element<D>& t) const {
        return uneven_ ? size_of((*this)(t)) : static_cast<double>(t.size()) * smallest_;
    }

  private:
    /// The number of mean steps from node 0 to a node along an axis.
    [[nodiscard]] double even_steps(std::size_t axis, std::int64_t node) const;
    /// Of a simplex with 2 to 4 corners.
    [[nodiscard]] static double size_of(std::span<const Double3> corners);

    Double3 origin_;
    std::array<Double3, 3> step_{};  ///< along each axis, from a node to the next; uneven: mean
    UnevenAxesPtr uneven_;
    double smallest_ = 0;  ///< size of an element with Element::size() == 1
};

// Tests. An interest test, test(t) or test(t, eta) with the element's Indicators, says whether an
// element is of interest. A stop test says in the same way whether it is accurate enough; it is not
// asked at the finest level, where everything stops. If it depends on the refinement node alone and
// its numbers are saturated (a node's is at least that of the nodes that its elements refine
// further), the leaves have no hanging nodes. Tests are called from many threads at once.

/// Interest: every element.
struct Everywhere {
    template <int D>
    [[nodiscard]] bool operator()(const Element<D>& /*t*/) const {
        return true;
    }
};

/// Interest: elements in which the finest function may take the isovalue (section 5 of the paper,
/// beta_0): it stays within the values at the vertices plus or minus the bound. Missing values
/// exclude nothing.
struct MayHoldIsovalue {
    double iso = 0;
    Field bound = Field::deviation_bar;  ///< REQUIRES: is_bound(bound)
    /// The bound is the field times this factor times the edge of the element's cube (in nodes). 0:
    /// the field itself is the bound.
    double by_edge = 0;

    template <int D>
    [[nodiscard]] bool operator()(const Element<D>& t, const Indicators& eta) const {
        const auto [low, high] = t.range();
        if (low <= iso && iso <= high) {
            return true;  // whatever the bound
        }
        const double scale =
            by_edge > 0 ? by_edge * static_cast<double>(std::int64_t{1} << t.level) : 1;
        return detail::may_reach(low, high, t.level > 0 ? eta(bound) * scale : 0, iso);
    }
};
/// By the tightest bound in the store. Throws Error{not_found} if it has none.
MayHoldIsovalue may_hold_isovalue(const Store& store, double iso);

/// Stop: nowhere above the finest level.
struct FullResolution {
    template <int D>
    [[nodiscard]] bool operator()(const Element<D>& /*t*/) const {
        return false;
    }
};

/// Stop: where a field is below a threshold, in its own units.
struct StopBelow {
    Field field = Field::deviation_bar;
    double threshold = 0;

    template <int D>
    [[nodiscard]] bool operator()(const Element<D>& /*t*/, const Indicators& eta) const {
        return threshold > 0 && eta(field) < threshold;
    }
};
/// The stop test of extract(). Throws Error{invalid_argument, not_found}.
StopBelow stop_below(const Store& store, const StopTest& test);

// Actions. An action is called with each leaf: action(t) or action(t, eta).

/// An action without shared data: fork() gives a new one for each part of the traversal, and the
/// parts are joined one at a time, in the order of the sequential traversal. So the result does not
/// depend on threads or memory, not even by rounding, if it depends on the leaves and on how they
/// are divided into parts; the division depends on the store alone.
template <class Action>
concept JoinableAction = std::move_constructible<Action> &&
    requires(const Action& action, Action& into, Action& part) {
    { action.fork() } -> std::same_as<Action>;
    into.join(part);
};

struct TraverseOptions {
    std::uint64_t memory = std::uint64_t{1} << 30U;  ///< maximum bytes of heap, without what the
                                                     ///< caller's functions allocate
    int threads = 0;                                 ///< 0 = all cores
    /// Only elements whose bounding boxes, along the lattice's axes, overlap this box; elements are
    /// not cut. Always excluded: elements entirely outside the volume.
    std::optional<WorldBox> box = {};
};

struct TraverseReport {
    std::uint64_t visited = 0;      ///< elements that were tested for interest
    std::uint64_t leaves = 0;       ///< elements that were passed to the action
    std::uint64_t chunks_read = 0;  ///< decoded, counting repetitions
};

/// The number of axes along which the store has more than one node.
int dimension_of(const Store& store);

namespace detail {

template <class Function, int D>
decltype(auto) call_with(const Function& function, const Element<D>& t, StoreNodes& nodes) {
    if constexpr (std::is_invocable_v<const Function&, const Element<D>&, const Indicators&>) {
        return function(t, Indicators(nodes, t));
    } else {
        return function(t);
    }
}

/// The caller's tests, in the form that the driver uses.
template <class Test>
struct CallersTest {
    const Test* test;

    [[nodiscard]] static std::optional<Field> field() { return std::nullopt; }
    template <int D>
    [[nodiscard]] bool may_hold(const Element<D>& t, double /*number*/, StoreNodes& nodes) const {
        return call_with(*test, t, nodes);
    }
    template <int D>
    [[nodiscard]] bool stops(const Element<D>& t, double /*eta*/, StoreNodes& nodes) const {
        return call_with(*test, t, nodes);
    }
};

/// What a traversal does in a part of the domain. Its functions are called once per part, from many
/// threads; the recursion over the elements of a part is compiled with the caller's functions.
template <int D>
class PartVisitor {
  public:
    /// The result of a part.
    class Part {
      public:
        Part() = default;
        Part(const Part&) = delete;
        Part& operator=(const Part&) = delete;
        virtual ~Part() = default;
        virtual void join() = 0;
    };
    PartVisitor() = default;
    PartVisitor(const PartVisitor&) = delete;
    PartVisitor& operator=(const PartVisitor&) = delete;
    virtual ~PartVisitor() = default;

    /// Visits elements; with `left`, only down to whole elements of `level`, which are added to it.
    /// Returns what is to be joined, in order; null if nothing is.
    virtual std::unique_ptr<Part> visit(StoreNodes& nodes, const LatticeRegion& region,
                                        std::span<const Element<D>> elements, int level,
                                        std::vector<Element<D>>* left, VisitCounts& counts,
                                        const Progress& progress) const = 0;
    /// The same without the action, for one element.
    virtual void look(StoreNodes& nodes, const LatticeRegion& region, const Element<D>& t,
                      int level, std::vector<Element<D>>& left) const = 0;
    /// Whether visit() returns parts; then the heap of one, in bytes.
    [[nodiscard]] virtual std::optional<std::uint64_t> part_heap() const = 0;
};

/// The elements of a part: those of a cube of at most this many levels. If parts are joined, they
/// are smaller.
template <int D>
constexpr int part_levels(bool are_joined) {
    return (are_joined ? 12 : 15) / D;
}
/// The maximum number of leaves of a part.
template <int D>
constexpr std::uint64_t part_leaves() {
    return (D == 3 ? std::uint64_t{6} : std::uint64_t{D})
           << static_cast<unsigned>(D * part_levels<D>(true));
}

/// Runs the parts in parallel.
template <int D>
TraverseReport traverse_parts(const Store& store, const PartVisitor<D>& visitor,
                              const TraverseOptions& options, Progress& progress);
extern template TraverseReport traverse_parts(const Store&, const PartVisitor<1>&,
                                              const TraverseOptions&, Progress&);
extern template TraverseReport traverse_parts(const Store&, const PartVisitor<2>&,
                                              const TraverseOptions&, Progress&);
extern template TraverseReport traverse_parts(const Store&, const PartVisitor<3>&,
                                              const TraverseOptions&, Progress&);

template <class Action>
constexpr std::uint64_t heap_of_part(std::uint64_t leaves) {
    if constexpr (requires { Action::heap_of(leaves); }) {
        return Action::heap_of(leaves);
    } else {
        return sizeof(Action);
    }
}

template <int D, class Interest, class Stop, class Action>
class CallersVisitor final : public PartVisitor<D> {
  public:
    CallersVisitor(const Interest& interest, const Stop& stop, Action& action)
        : interest_{&interest}, stop_{&stop}, action_(action) {}

    std::unique_ptr<typename PartVisitor<D>::Part> visit(StoreNodes& nodes,
                                                         const LatticeRegion& region,
                                                         std::span<const Element<D>> elements,
                                                         int level, std::vector<Element<D>>* left,
                                                         VisitCounts& counts,
                                                         const Progress& progress) const override {
        if constexpr (JoinableAction<Action>) {
            auto part = std::make_unique<JoinedPart>(action_);
            run(part->action, nodes, region, elements, level, left, counts, progress);
            return part;
        } else {
            run(action_, nodes, region, elements, level, left, counts, progress);
            return nullptr;
        }
    }
    void look(StoreNodes& nodes, const LatticeRegion& region, const Element<D>& t, int level,
              std::vector<Element<D>>& left) const override {
        Traversal traversal(nodes, region, interest_, stop_);
        auto nothing = [](const Element<D>&, double, Overlap) {};
        traversal.above(t, level, nothing, left);
    }
    [[nodiscard]] std::optional<std::uint64_t> part_heap() const override {
        return JoinableAction<Action> ? std::optional(heap_of_part<Action>(part_leaves<D>()))
                                      : std::nullopt;
    }

  private:
    using Traversal = AdaptTraverse<Element<D>, StoreNodes, LatticeRegion, CallersTest<Interest>,
                                    CallersTest<Stop>>;
    struct JoinedPart final : PartVisitor<D>::Part {
        explicit JoinedPart(Action& all) : whole(all), action(std::as_const(all).fork()) {}
        void join() override { whole.join(action); }
        Action& whole;
        Action action;
    };

    static constexpr std::uint64_t kCheckEvery = 4096;

    void run(Action& to, StoreNodes& nodes, const LatticeRegion& region,
             std::span<const Element<D>> elements, int level, std::vector<Element<D>>* left,
             VisitCounts& counts, const Progress& progress) const {
        Traversal traversal(nodes, region, interest_, stop_);
        std::uint64_t count = 0;
        auto act = [&](const Element<D>& t, double, Overlap) {
            if (++count % kCheckEvery == 0) {
                progress.check();
            }
            if constexpr (std::is_invocable_v<Action&, const Element<D>&, const Indicators&>) {
                to(t, Indicators(nodes, t));
            } else {
                to(t);
            }
        };
        for (const Element<D>& t : elements) {
            if (left != nullptr) {
                traversal.above(t, level, act, *left);
            } else {
                traversal.subtree(t, act);
            }
        }
        counts.add(traversal.counts());
    }

    CallersTest<Interest> interest_;
    CallersTest<Stop> stop_;
    Action& action_;
};

}  // namespace detail

/// The paper's AdaptTraverse, in parallel. `interest`, `stop` and `action` are functions or objects
/// of any type, called without indirection: see "Tests" and "Actions" above. An action that is not
/// joinable is called from many threads at once.
///
/// The store may be larger than memory, or at a URL: then subtrees are first walked by the same
/// tests, and what their elements read is fetched many chunks at a time, at first except for the
/// fields of which the tests have not asked yet.
///
/// Throws Error{invalid_argument} if dimension_of(store) != D or the box is empty, Error{limit}
/// (memory), Error{corrupt, io, cancelled}, and what the caller's functions throw. Thread-safety:
/// any number of concurrent calls, also on the same store.
template <int D, class Interest, class Stop, class Action>
TraverseReport adapt_traverse(const Store& store, const Interest& interest, const Stop& stop,
                              Action&& action, const TraverseOptions& options = {},
                              Progress& progress = silent_progress()) {
    return detail::traverse_parts<D>(
        store,
        detail::CallersVisitor<D, Interest, Stop, std::remove_reference_t<Action>>(interest, stop,
                                                                                   action),
        options, progress);
}

/// The leaves of the whole domain: the mesh of section 7 of the paper.
template <int D, class Stop, class Action>
TraverseReport for_each_leaf(const Store& store, const Stop& stop, Action&& action,
                             const TraverseOptions& options = {},
                             Progress& progress = silent_progress()) {
    return adapt_traverse<D>(store, Everywhere(), stop, std::forward<Action>(action), options,
                             progress);
}

/// Makes an action from a function that is called for one leaf at a time, in the order of the
/// sequential traversal, whatever the number of threads: adapt_traverse<3>(store, interest, stop,
/// in_order<3>(function)). The tests still run in parallel; leaves wait for their turn, which takes
/// memory of the budget (about 10 MiB for each of two or three parts
/// per thread).
template <int D, class Function>
class InOrder {
  public:
    explicit InOrder(Function& function) : function_(&function) {}

    void operator()(const Element<D>& t) { leaves_.push_back(t); }
    [[nodiscard]] InOrder fork() const { return InOrder(*function_); }
    void join(InOrder& part) {
        for (const Element<D>& t : part.leaves_) {
            (*function_)(t);
        }
    }
    static constexpr std::uint64_t heap_of(std::uint64_t leaves) {
        // While the vector grows, it exists twice.
        return 3 * leaves * sizeof(Element<D>);
    }

  private:
    Function* function_;
    std::vector<Element<D>> leaves_;
};
/// The function must outlive the action.
template <int D, class Function>
InOrder<D, std::remove_reference_t<Function>> in_order(Function&& function) {
    return InOrder<D, std::remove_reference_t<Function>>(function);
}

}  // namespace isonest
