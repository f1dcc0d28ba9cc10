// PLY files with false headers, and files as other programs write them.
#include "tools/drawing/input/ply_reader.h"

#include <catch2/catch.hpp>
#include <optional>

#include <isonest/error.h>

#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::cli;
using namespace isonest::detail::test;

namespace {

template <class T>
std::string bytes_of(std::initializer_list<T> values) {
    std::string out;
    for (const T v : values) {
        out.append(reinterpret_cast<const char*>(&v), sizeof(v));
    }
    return out;
}

const std::string ply_line = "ply\nformat binary_little_endian 1.0\n";
const std::string xyz_lines = "property float x\nproperty float y\nproperty float z\n";
const std::string list_line = "property list uchar int vertex_indices\n";
const std::string quad_header = ply_line + "comment a quad\nelement vertex 4\n" + xyz_lines +
                                "element face 2\n" + list_line + "end_header\n";
const std::string quad_vertices = bytes_of<float>({0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0.5F});

std::string face(std::initializer_list<std::int32_t> corners) {
    return static_cast<char>(corners.size()) + bytes_of<std::int32_t>(corners);
}
const std::string quad_faces = face({0, 1, 2}) + face({0, 2, 3});

/// Reads the whole mesh; returns the kind of the failure, if any.
std::optional<ErrorKind> failure_of(const std::string& bytes, std::string* message = nullptr) {
    const TemporaryFolder folder;
    const auto path = folder / "mesh.ply";
    std::ofstream(path, std::ios::binary) << bytes;
    try {
        const PlyMesh mesh(path);
        for (std::uint64_t i = 0; i < mesh.triangles(); ++i) {
            for (const std::uint32_t v : mesh.triangle(i)) {
                (void)mesh.vertex(v);
            }
        }
        for (std::uint64_t i = 0; i < mesh.vertices(); ++i) {
            (void)mesh.vertex(i);
        }
    } catch (const Error& e) {
        if (message != nullptr) {
            *message = e.what();
        }
        CHECK(std::string(e.what()).find("mesh.ply") != std::string::npos);
        return e.kind();
    }
    return std::nullopt;
}

std::string replaced(std::string text, const std::string& from, const std::string& to) {
    const std::size_t at = text.find(from);
    REQUIRE(at != std::string::npos);
    return text.replace(at, from.size(), to);
}

}  // namespace

TEST_CASE("a mesh written by isonest is read back unchanged") {
    const TemporaryFolder folder;
    std::ofstream(folder / "mesh.ply", std::ios::binary)
        << quad_header << quad_vertices << quad_faces;
    const PlyMesh mesh(folder / "mesh.ply");
    REQUIRE(mesh.vertices() == 4);
    REQUIRE(mesh.triangles() == 2);
    CHECK(mesh.vertex(3) == Double3{0, 1, 0.5});
    CHECK(mesh.triangle(1) == std::array<std::uint32_t, 3>{0, 2, 3});
}

TEST_CASE("doubles, other properties, uint indices, later elements and CRLF are read") {
    std::string header =
        "ply\r\nformat binary_little_endian 1.0\r\nobj_info made elsewhere\r\n"
        "element vertex 3\r\nproperty uchar red\r\nproperty double z\r\nproperty double x\r\n"
        "property short s\r\nproperty double y\r\nelement face 1\r\nproperty float quality\r\n"
        "property list uint8 uint32 vertex_index\r\nproperty uchar flags\r\n"
        "element edge 1\r\nproperty list uchar int what\r\nend_header\r\n";
    std::string data;
    for (const double i : {0.0, 1.0, 2.0}) {
        data += bytes_of<std::uint8_t>({9}) + bytes_of<double>({i + 0.3, i + 0.1}) +
                bytes_of<std::int16_t>({-1}) + bytes_of<double>({i + 0.2});
    }
    data += bytes_of<float>({7}) + '\3' + bytes_of<std::uint32_t>({2, 1, 0}) + '\1';
    const TemporaryFolder folder;
    std::ofstream(folder / "mesh.ply", std::ios::binary) << header << data << "edges";
    const PlyMesh mesh(folder / "mesh.ply");
    CHECK(mesh.vertex(1) == Double3{1.1, 1.2, 1.3});
    CHECK(mesh.triangle(0) == std::array<std::uint32_t, 3>{2, 1, 0});
}

TEST_CASE("a mesh without vertices and triangles is valid") {
    CHECK_FALSE(failure_of(ply_line + "element vertex 0\n" + xyz_lines + "element face 0\n" +
                           list_line + "end_header\n"));
}

TEST_CASE("a truncated file, or one with additional bytes, is corrupt") {
    const std::string whole = quad_header + quad_vertices + quad_faces;
    REQUIRE_FALSE(failure_of(whole));
    for (std::size_t size = 0; size < whole.size(); ++size) {
        CAPTURE(size);
        REQUIRE(failure_of(whole.substr(0, size)) == ErrorKind::corrupt);
    }
    CHECK(failure_of(whole + '\0') == ErrorKind::corrupt);
}

TEST_CASE("counts that do not fit into the file are corrupt, without a large allocation") {
    const std::string whole = quad_header + quad_vertices + quad_faces;
    for (const char* count :
         {"5", "3", "4294967296", "1537228672809129302", "18446744073709551615",
          "18446744073709551616", "99999999999999999999999", "-1", "4.0", "x"}) {
        CAPTURE(count);
        CHECK(failure_of(replaced(whole, "vertex 4", std::string("vertex ") + count)) ==
              ErrorKind::corrupt);
        if (std::string(count) != "3") {
            CHECK(failure_of(replaced(whole, "face 2", std::string("face ") + count)) ==
                  ErrorKind::corrupt);
        }
    }
}

TEST_CASE("for indices beyond the vertices the message names the face") {
    std::string message;
    CHECK(failure_of(quad_header + quad_vertices + face({0, 1, 2}) + face({0, 4, 3}), &message) ==
          ErrorKind::corrupt);
    CHECK(message.find("face 1: refers to vertex 4") != std::string::npos);
    CHECK(failure_of(quad_header + quad_vertices + face({0, -1, 2}) + face({0, 2, 3}), &message) ==
          ErrorKind::corrupt);
    CHECK(message.find("face 0: refers to vertex -1") != std::string::npos);
}

TEST_CASE("corner counts other than 3 are refused in a file of the right size") {
    std::string faces = quad_faces;
    faces[0] = 4;
    CHECK(failure_of(quad_header + quad_vertices + faces) == ErrorKind::unsupported);
    faces[0] = 0;
    CHECK(failure_of(quad_header + quad_vertices + faces) == ErrorKind::unsupported);
}

TEST_CASE("for coordinates that are not finite the message names the vertex") {
    std::string vertices = quad_vertices;
    const float nan = std::numeric_limits<float>::quiet_NaN();
    vertices.replace(12, 4, bytes_of<float>({nan}));
    std::string message;
    CHECK(failure_of(quad_header + vertices + quad_faces, &message) == ErrorKind::corrupt);
    CHECK(message.find("vertex 1") != std::string::npos);
}

TEST_CASE("unsupported headers are refused, and the message names the line") {
    const std::string data = quad_vertices + quad_faces;
    const std::vector<std::array<const char*, 2>> changes{
        {"binary_little_endian", "binary_big_endian"},
        {"binary_little_endian 1.0", "ascii 1.0"},
        {"property float x", "property int x"},
        {"property float x", "property list uchar int x"},
        {"property float x", "property quad x"},
        {"property float x", "property"},
        {"uchar int", "int int"},
        {"uchar int", "uchar float"},
        {"uchar int", "uchar short"},
        {"vertex_indices", "neighbours"},
        {"element vertex", "element points"},
        {"element face", "element vertex"},
        {"comment a quad", "element face 2"},
        {"comment a quad", "remark"},
        {"comment a quad", "property float w"},
        {"ply\n", "PLY\n"},
        {"element vertex 4", "element vertex"},
        {"format binary_little_endian 1.0\n", ""},
        {"property float y\n", ""},
        {"property list uchar int vertex_indices\n", ""},
    };
    for (const auto& [from, to] : changes) {
        CAPTURE(from, to);
        CHECK(failure_of(replaced(quad_header, from, to) + data).has_value());
    }
    CHECK(failure_of("") == ErrorKind::corrupt);
    CHECK(failure_of("ply") == ErrorKind::corrupt);
    CHECK(failure_of("ply\n" + std::string(200'000, 'c')) == ErrorKind::corrupt);
}

TEST_CASE("a missing mesh file is reported as not found") {
    const TemporaryFolder folder;
    try {
        const PlyMesh mesh(folder / "none.ply");
        FAIL("was opened");
    } catch (const Error& e) {
        CHECK(e.kind() == ErrorKind::not_found);
    }
}

TEST_CASE("a value stored as double is read as double") {
    const TemporaryFolder folder;
    const auto path = folder / "mesh.ply";
    std::ofstream(path, std::ios::binary)
        << replaced(quad_header, "vertex 4\n", "vertex 1\nproperty double value\n")
        << bytes_of<double>({1e9 + 0.125}) << bytes_of<float>({1, 2, 3}) << quad_faces;
    const PlyMesh mesh(path);
    CHECK(mesh.value(0) == 1e9 + 0.125);
    CHECK(mesh.vertex(0) == Double3{1, 2, 3});
}
