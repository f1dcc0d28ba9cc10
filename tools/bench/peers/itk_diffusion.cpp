// GradientAnisotropicDiffusionImageFilter of ITK on a raw float32 volume: time and result.
//
// usage: isonest_itk_diffusion IN.raw NX NY NZ ITERATIONS TIME_STEP CONDUCTANCE THREADS OUT.raw
//
// Prints the seconds that the filter's Update() takes.
#include <itkGradientAnisotropicDiffusionImageFilter.h>
#include <itkImage.h>
#include <itkMultiThreaderBase.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>

int main(int argc, char** argv) {
    if (argc != 10) {
        std::fprintf(stderr,
                     "usage: %s IN.raw NX NY NZ ITERATIONS TIME_STEP CONDUCTANCE THREADS OUT.raw\n",
                     argv[0]);
        return 2;
    }
    using Image = itk::Image<float, 3>;
    const auto size = [&](int i) { return static_cast<itk::SizeValueType>(std::atoll(argv[i])); };
    itk::MultiThreaderBase::SetGlobalMaximumNumberOfThreads(
        static_cast<itk::ThreadIdType>(std::atoi(argv[8])));
    const Image::Pointer image = Image::New();
    Image::RegionType region;
    region.SetSize({{size(2), size(3), size(4)}});
    image->SetRegions(region);
    image->Allocate();
    const auto bytes = static_cast<std::streamsize>(size(2) * size(3) * size(4) * sizeof(float));
    std::ifstream in(argv[1], std::ios::binary);
    if (!in.read(reinterpret_cast<char*>(image->GetBufferPointer()), bytes)) {
        std::fprintf(stderr, "%s: too short\n", argv[1]);
        return 1;
    }
    const auto filter = itk::GradientAnisotropicDiffusionImageFilter<Image, Image>::New();
    filter->SetInput(image);
    filter->SetNumberOfIterations(static_cast<unsigned>(std::atoi(argv[5])));
    filter->SetTimeStep(std::atof(argv[6]));
    filter->SetConductanceParameter(std::atof(argv[7]));
    const auto start = std::chrono::steady_clock::now();
    filter->Update();
    const double seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    std::ofstream out(argv[9], std::ios::binary);
    out.write(reinterpret_cast<const char*>(filter->GetOutput()->GetBufferPointer()), bytes);
    std::printf("%.6f\n", seconds);
    return out ? 0 : 1;
}
