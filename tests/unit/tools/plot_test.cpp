#include "tests/support/temporary_folder.hpp"
#include "tests/support/tools/run_command.hpp"
#include "tools/commands/commands.hpp"
#include "tools/plot/figure.hpp"
#include "tools/plot/map.hpp"

#include <cstring>

using nilio::tests::run_command;
using nilio::tests::TemporaryFolder;
using namespace nilio::tools;
using namespace nilio::tools::plot;

TEST_CASE("tick steps are one, two or five times a power of ten", "[plot]") {
  CHECK(nice_step(10.0, 10) == Approx(1.0));
  CHECK(nice_step(10.1, 10) == Approx(2.0));
  CHECK(nice_step(0.3, 10) == Approx(0.05));
  CHECK(nice_step(8000.0, 10) == Approx(1000.0));
}

TEST_CASE("the y axis points upwards", "[plot]") {
  const Axes axes{{100.0, 50.0, 200.0, 100.0}, 0.0, 2.0, 0.0, 1.0};
  CHECK(axes.to_pixel({0.0, 0.0}) == Eigen::Vector2d(100.0, 150.0));
  CHECK(axes.to_pixel({2.0, 1.0}) == Eigen::Vector2d(300.0, 50.0));
}

TEST_CASE("a binary PLY map with further properties is read, a truncated one is refused", "[plot]") {
  const TemporaryFolder folder;
  std::string content =
      "ply\nformat binary_little_endian 1.0\ncomment made for this test\nelement vertex 2\nproperty uchar "
      "red\n"
      "property float x\nproperty float y\nproperty double z\nend_header\n";
  for (const float base : {1.0F, 10.0F}) {
    const std::array<float, 2> xy{base, base + 1.0F};
    const double z = static_cast<double>(base) + 2.0;
    std::array<char, 17> record{};
    std::memcpy(record.data() + 1, xy.data(), 8);
    std::memcpy(record.data() + 9, &z, 8);
    content.append(record.data(), record.size());
  }
  const auto points = read_map_points(folder.write("map.ply", content));
  REQUIRE(points);
  REQUIRE(points->size() == 2);
  CHECK((*points)[1] == Eigen::Vector3f(10.0F, 11.0F, 12.0F));
  content.pop_back();
  CHECK(read_map_points(folder.write("cut.ply", content)).error().message.find("1 of 2") !=
        std::string::npos);
  CHECK_FALSE(
      read_map_points(folder.write("ascii.ply", "ply\nformat ascii 1.0\nelement vertex 0\nend_header\n")));
  CHECK_FALSE(read_map_points(
      folder.write("huge.ply",
                   "ply\nformat binary_little_endian 1.0\nelement vertex 99999999999\nproperty "
                   "float x\nproperty float y\nproperty float z\nend_header\n")));
  CHECK_FALSE(read_map_points(folder.write("map.pcd", content)));
}

TEST_CASE("an invalid xyz map is refused with the line number", "[plot]") {
  const TemporaryFolder folder;
  const auto points = read_map_points(folder.write("map.xyz", "# x y z\n1 2 3 255\n4 5 6\n"));
  REQUIRE(points);
  CHECK(points->size() == 2);
  CHECK(read_map_points(folder.write("bad.xyz", "1 2 3\n1 2\n")).error().message.find("bad.xyz:2") !=
        std::string::npos);
}

TEST_CASE("map points are drawn on their pixels, those outside are left out", "[plot]") {
  const Axes axes{{10.0, 20.0, 4.0, 4.0}, 0.0, 4.0, 0.0, 4.0};
  const Raster raster =
      rasterise_map({{0.5F, 0.5F, 0.0F}, {3.5F, 3.5F, 5.0F}, {9.0F, 1.0F, 0.0F}, {NAN, 1.0F, 0.0F}}, axes);
  REQUIRE(raster.pixels.size() == 16);
  CHECK(std::count(raster.pixels.begin(), raster.pixels.end(), 0U) == 14);
  CHECK(raster.pixels[12] != 0);
  CHECK(raster.pixels[3] != 0);
}

TEST_CASE("plot writes a picture, and fails for files that cannot be read or written", "[plot]") {
  const TemporaryFolder folder;
  const std::string path = folder.write("a.tum", "0 0 0 0 0 0 0 1\n0.1 1 0.2 0 0 0 0 1\n0.2 2 0 0 0 0 0 1\n");
  const std::string still = folder.write("still.tum", "0 0 0 0 0 0 0 1\n");
  const auto run = [](std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "plot");
    return run_command(add_plot_command, arguments);
  };
  CHECK(run({path, "--truth", path, "-o", folder.file("a.png")}) == 0);
  CHECK(nilio::tests::read_file(folder.file("a.png")).starts_with("\x89PNG"));
  CHECK(run({path, path, "-o", folder.file("a.svg")}) == 0);
  CHECK(nilio::tests::read_file(folder.file("a.svg")).find("<svg") != std::string::npos);
  CHECK(run({still, "-o", folder.file("still.png")}) == 0);
  CHECK(run({path, "-o", folder.file("a.gif")}) == 1);
  CHECK(run({path, "-o", folder.file("no/such/folder.png")}) == 1);
  CHECK(run({path, "--map", folder.file("missing.ply"), "-o", folder.file("a.png")}) == 1);
  CHECK(run({path, "--truth", still, "-o", folder.file("a.png")}) == 1);
}

TEST_CASE("SVG text remains text, and names stand beside their curves", "[plot]") {
  const TemporaryFolder folder;
  Figure figure{{Panel{}}};
  figure.panels[0].x.label = "time & place";
  figure.panels[0].curves = {{"first", {{0.0, 1.0}, {1.0, 2.0}}}, {"second", {{0.0, 1.0}, {1.0, 2.0}}}};
  REQUIRE(save_figure(figure, folder.file("a.svg"), 400, 300));
  const std::string svg = nilio::tests::read_file(folder.file("a.svg"));
  for (const char* text : {">first</text>", ">second</text>", ">time &amp; place</text>"})
    CHECK(svg.find(text) != std::string::npos);
  CHECK(figure_csv(figure) ==
        "panel,curve,x,y\n1,\"first\",0,1\n1,\"first\",1,2\n1,\"second\",0,1\n1,\"second\",1,2\n");
}

TEST_CASE("more than eight curves are refused", "[plot]") {
  const TemporaryFolder folder;
  Figure figure{{Panel{}}};
  figure.panels[0].curves.resize(kMaxCurves);
  CHECK(save_figure(figure, folder.file("a.png"), 400, 300));
  figure.panels[0].curves.resize(kMaxCurves + 1);
  CHECK(save_figure(figure, folder.file("a.png"), 400, 300).error().message.find("at most 8") !=
        std::string::npos);
}

TEST_CASE("camera and vehicle poses are refused together unless the plane is chosen", "[plot]") {
  const TemporaryFolder folder;
  std::string camera;
  std::string vehicle;
  for (int i = 0; i < 10; ++i) {
    camera += "1 0 0 0 0 1 0 0 0 0 1 " + std::to_string(i) + "\n";
    vehicle += std::to_string(i) + " " + std::to_string(i) + " 0 0 0 0 0 1\n";
  }
  const std::string kitti = folder.write("camera.txt", camera);
  const std::string tum = folder.write("vehicle.tum", vehicle);
  const auto run = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "plot");
    arguments.insert(arguments.end(), {"-o", folder.file("a.png")});
    return nilio::tests::capture_command(add_plot_command, arguments);
  };
  CHECK(run({kitti, kitti}).status == 0);
  const auto refused = run({tum, kitti});
  CHECK(refused.status == 1);
  CHECK(refused.errors.find("camera has camera poses") != std::string::npos);
  const auto warned = run({tum, kitti, "--plane", "xy"});
  CHECK(warned.status == 0);
  CHECK(warned.errors.find("warning") != std::string::npos);
}
