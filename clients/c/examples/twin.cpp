// Reads a field and asks a question, with the RAII header.
//   c++ -std=c++17 twin.cpp $(pkg-config --cflags --libs softtwin) -o twin && ./twin finger
#include <algorithm>
#include <iostream>
#include <softtwin.hpp>

int main(int argc, char **argv) try {
    const std::string actuator = argc > 1 ? argv[1] : "finger";
    softtwin::Bus bus;
    softtwin::FieldReader fields(bus, actuator);
    std::optional<softtwin::Field> field = fields.next(std::chrono::seconds(5));
    if (!field) throw std::runtime_error("no field within 5 s");
    const softtwin::Values stress = field->values(SOFTTWIN_FIELD_VON_MISES);
    std::cout << "field " << field->header().seq << ", " << softtwin_regime_name(field->header().regime) << ": " << stress.size()
              << " nodes, largest stress "
              << *std::max_element(stress.begin(), stress.end()) << " MPa\n";

    softtwin::Client twin(bus, actuator);
    const softtwin_answer answer = twin.whatif(0.05, 25.0);
    std::cout << "what if: " << answer.contact_force_n << " N\n";
    try {
        twin.pressure(1000.0, 25.0);
    } catch (const softtwin::Error &refused) {
        std::cout << "refused: " << refused.what() << "\n";
        return refused.status() == SOFTTWIN_REFUSED ? 0 : 1;
    }
    return 1;
} catch (const std::exception &error) {
    std::cerr << error.what() << "\n";
    return 1;
}
