// Owns the valve of an actuator for some seconds: holds a pressure (MPa), renewed four times within its validity, and releases it.
//   c++ -std=c++17 setpoint.cpp $(pkg-config --cflags --libs softtwin) -o setpoint && ./setpoint finger 0.02 5
#include <cmath>
#include <iostream>
#include <softtwin.hpp>
#include <string>
#include <thread>

int main(int argc, char **argv) try {
    using clock = std::chrono::steady_clock;
    const std::string actuator = argc > 1 ? argv[1] : "finger";
    const double pressure_mpa = argc > 2 ? std::stod(argv[2]) : 0.02;
    const std::chrono::duration<double> held(argc > 3 ? std::stod(argv[3]) : 5.0);
    constexpr std::chrono::milliseconds valid(200);
    softtwin::Bus bus;
    softtwin::SetpointWriter valve(bus, actuator, "setpoint.cpp");
    const auto begin = clock::now();
    for (auto next = begin; next - begin < held; next += valid / 4) {
        std::this_thread::sleep_until(next);
        valve.send(pressure_mpa, valid);
    }
    valve.send(std::nan(""), valid); // releases: the valve closes at once
    return 0;
} catch (const std::exception &error) {
    std::cerr << error.what() << "\n";
    return 1;
}
