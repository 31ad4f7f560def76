// RAII over softtwin.h, C++17, header only. Failures are softtwin::Error; handles end with their objects and belong to the
// thread that made them. How to use it: docs/clients/c.md.
#ifndef SOFTTWIN_HPP
#define SOFTTWIN_HPP

#include <chrono>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "softtwin.h"

namespace softtwin {

/// A failure: status and message.
class Error : public std::runtime_error {
public:
    Error(softtwin_status status, const std::string &text) : std::runtime_error(text), status_(status) {}
    softtwin_status status() const noexcept { return status_; }

private:
    softtwin_status status_;
};

inline void check(softtwin_status status) {
    if (status != SOFTTWIN_OK) throw Error(status, softtwin_last_error());
}

namespace detail {
template <typename T, void (*End)(T *)> struct Ender {
    void operator()(T *handle) const noexcept { End(handle); }
};
template <typename T, void (*End)(T *)> using Handle = std::unique_ptr<T, Ender<T, End>>;

inline int64_t ms(std::chrono::milliseconds time) { return static_cast<int64_t>(time.count()); }

/// False: the time is over.
inline bool came(softtwin_status status) {
    if (status == SOFTTWIN_TIMEOUT) return false;
    check(status);
    return true;
}
} // namespace detail

/// Membership in a shared-memory domain; empty names: those of the environment, or iceoryx2's default.
class Bus {
public:
    explicit Bus(const std::string &domain = "", const std::string &root = "") {
        softtwin_bus *bus = nullptr;
        check(softtwin_bus_open(domain.empty() ? nullptr : domain.c_str(), root.empty() ? nullptr : root.c_str(), &bus));
        handle_.reset(bus);
    }
    softtwin_bus *get() const noexcept { return handle_.get(); }

private:
    detail::Handle<softtwin_bus, softtwin_bus_close> handle_;
};

namespace detail {
/// The kind of topic that carries a payload.
template <typename Payload> struct Kind;
template <> struct Kind<softtwin_sensor_sample> { static constexpr const char *name = "sensor"; };
template <> struct Kind<softtwin_state> { static constexpr const char *name = "state"; };
template <> struct Kind<softtwin_health> { static constexpr const char *name = "health"; };
template <> struct Kind<softtwin_grasp> { static constexpr const char *name = "grasp"; };
template <> struct Kind<softtwin_command> { static constexpr const char *name = "command"; };
template <> struct Kind<softtwin_estimate> { static constexpr const char *name = "estimate"; };
template <> struct Kind<softtwin_setpoint> { static constexpr const char *name = "setpoint"; };
template <> struct Kind<softtwin_valve> { static constexpr const char *name = "valve"; };

using Reader = Handle<softtwin_reader, softtwin_reader_close>;

inline Reader open_reader(const Bus &bus, const std::string &name, const char *kind, const char *node_set) {
    softtwin_reader *reader = nullptr;
    check(softtwin_reader_open(bus.get(), name.c_str(), kind, node_set, &reader));
    return Reader(reader);
}

using Writer = Handle<softtwin_writer, softtwin_writer_close>;

inline Writer open_writer(const Bus &bus, const std::string &name, const char *kind) {
    softtwin_writer *writer = nullptr;
    check(softtwin_writer_open(bus.get(), name.c_str(), kind, &writer));
    return Writer(writer);
}
} // namespace detail

/// A reader of a topic whose payload is copied.
template <typename Payload> class PayloadReader {
public:
    /// `cavity`: of setpoints and valves that of `pressure_mpa.<cavity>`.
    PayloadReader(const Bus &bus, const std::string &name, const std::string &cavity = "")
        : reader_(detail::open_reader(bus, name, (detail::Kind<Payload>::name + (cavity.empty() ? "" : "/" + cavity)).c_str(), nullptr)) {}
    /// The oldest waiting sample; waits for one at most `timeout`. Nothing: the time is over.
    std::optional<Payload> next(std::chrono::milliseconds timeout) { return read(0, timeout); }
    /// As next, with the newest waiting sample.
    std::optional<Payload> newest(std::chrono::milliseconds timeout) { return read(1, timeout); }

private:
    std::optional<Payload> read(int newest, std::chrono::milliseconds timeout) {
        Payload payload{};
        if (!detail::came(softtwin_reader_read(reader_.get(), newest, detail::ms(timeout), &payload, sizeof payload)))
            return std::nullopt;
        return payload;
    }
    detail::Reader reader_;
};

using SensorReader = PayloadReader<softtwin_sensor_sample>;
using StateReader = PayloadReader<softtwin_state>;
using HealthReader = PayloadReader<softtwin_health>;
using GraspReader = PayloadReader<softtwin_grasp>;
using CommandReader = PayloadReader<softtwin_command>;
using EstimateReader = PayloadReader<softtwin_estimate>;
using SetpointReader = PayloadReader<softtwin_setpoint>;
using ValveReader = PayloadReader<softtwin_valve>;

/// Values of one field in shared memory, one a node; valid as long as their Field.
class Values {
public:
    Values(const float *data, std::size_t size) : data_(data), size_(size) {}
    const float *begin() const noexcept { return data_; }
    const float *end() const noexcept { return data_ + size_; }
    const float *data() const noexcept { return data_; }
    std::size_t size() const noexcept { return size_; }
    float operator[](std::size_t node) const noexcept { return data_[node]; }

private:
    const float *data_;
    std::size_t size_;
};

/// A received field: shared memory until it ends. At most 4 may be held of one topic.
class Field {
public:
    explicit Field(softtwin_field *field) : handle_(field) {}
    const softtwin_field_header &header() const noexcept { return *softtwin_field_get_header(handle_.get()); }
    /// One field, for example SOFTTWIN_FIELD_X.
    Values values(uint8_t field_id) const {
        const float *data = nullptr;
        std::size_t size = 0;
        check(softtwin_field_values(handle_.get(), field_id, &data, &size));
        return Values(data, size);
    }

private:
    detail::Handle<softtwin_field, softtwin_field_release> handle_;
};

/// A reader of fields; an empty node set: all nodes.
class FieldReader {
public:
    FieldReader(const Bus &bus, const std::string &actuator, const std::string &node_set = "")
        : reader_(detail::open_reader(bus, actuator, "field", node_set.empty() ? nullptr : node_set.c_str())) {}
    std::optional<Field> next(std::chrono::milliseconds timeout) { return read(0, timeout); }
    std::optional<Field> newest(std::chrono::milliseconds timeout) { return read(1, timeout); }

private:
    std::optional<Field> read(int newest, std::chrono::milliseconds timeout) {
        softtwin_field *field = nullptr;
        if (!detail::came(softtwin_reader_read_field(reader_.get(), newest, detail::ms(timeout), &field))) return std::nullopt;
        return Field(field);
    }
    detail::Reader reader_;
};

/// The one writer of an actuator's readings, in place of a bridge.
class SensorWriter {
public:
    SensorWriter(const Bus &bus, const std::string &actuator) : writer_(detail::open_writer(bus, actuator, "sensor")) {}
    /// Pressure in MPa, gap in mm, measured force in N; NaN: not measured.
    void send(double pressure_mpa, double gap_mm, double measured_force_n) {
        check(softtwin_writer_send_reading(writer_.get(), pressure_mpa, gap_mm, measured_force_n));
    }
    /// The same with further inputs of the model by name, in the unit at the end of each name.
    void send(double pressure_mpa, double gap_mm, double measured_force_n, const std::vector<std::pair<std::string, double>> &inputs) {
        std::vector<const char *> names;
        std::vector<double> values;
        for (const auto &input : inputs) {
            names.push_back(input.first.c_str());
            values.push_back(input.second);
        }
        check(softtwin_writer_send_inputs(writer_.get(), pressure_mpa, gap_mm, measured_force_n, names.data(), values.data(),
                                          names.size()));
    }

private:
    detail::Writer writer_;
};

/// The one writer of an actuator's pressure commands.
class CommandWriter {
public:
    CommandWriter(const Bus &bus, const std::string &actuator) : writer_(detail::open_writer(bus, actuator, "command")) {}
    /// Pressure wanted, MPa, and the stamp of the reading that it answers (0: none).
    void send(double pressure_mpa, uint64_t t_sensor_ns = 0) {
        check(softtwin_writer_send_command(writer_.get(), pressure_mpa, t_sensor_ns));
    }

private:
    detail::Writer writer_;
};

/// The owner of an actuator's valve, under a name by which a second one is refused.
class SetpointWriter {
public:
    /// `cavity`: the one of the input `pressure_mpa.<cavity>`; empty: that of `pressure_mpa`.
    SetpointWriter(const Bus &bus, const std::string &actuator, const std::string &owner, const std::string &cavity = "") {
        softtwin_writer *writer = nullptr;
        const char *of = cavity.empty() ? nullptr : cavity.c_str();
        check(softtwin_writer_open_setpoint(bus.get(), actuator.c_str(), of, owner.c_str(), &writer));
        writer_.reset(writer);
    }
    /// Pressure wanted, MPa (NaN: none), for how long it counts, and the stamp of the reading that it answers (0: none).
    void send(double pressure_mpa, std::chrono::milliseconds valid, uint64_t t_sensor_ns = 0) {
        check(softtwin_writer_send_setpoint(writer_.get(), pressure_mpa, static_cast<uint32_t>(valid.count()), t_sensor_ns));
    }

private:
    detail::Writer writer_;
};

/// Questions to the twin of one actuator; a refusal is an Error with SOFTTWIN_REFUSED.
class Client {
public:
    Client(const Bus &bus, const std::string &actuator) {
        softtwin_client *client = nullptr;
        check(softtwin_client_open(bus.get(), actuator.c_str(), &client));
        handle_.reset(client);
    }
    /// State and force at a pressure (MPa) and a gap (mm).
    softtwin_answer whatif(double pressure_mpa, double gap_mm) {
        softtwin_query query = softtwin_query_new(SOFTTWIN_QUERY_WHATIF);
        query.pressure_mpa = pressure_mpa;
        query.gap_mm = gap_mm;
        return ask(query);
    }
    /// The lowest pressure with this force (N) at this gap (mm).
    softtwin_answer pressure(double force_n, double gap_mm) {
        softtwin_query query = softtwin_query_new(SOFTTWIN_QUERY_PRESSURE);
        query.force_n = force_n;
        query.gap_mm = gap_mm;
        return ask(query);
    }
    /// The gap that explains a force (N, known to force_halfwidth_n) at a pressure (MPa).
    softtwin_answer gap(double pressure_mpa, double force_n, double force_halfwidth_n = 0.0) {
        softtwin_query query = softtwin_query_new(SOFTTWIN_QUERY_GAP);
        query.pressure_mpa = pressure_mpa;
        query.force_n = force_n;
        query.force_halfwidth_n = force_halfwidth_n;
        return ask(query);
    }
    /// Any question; with want_field set, `values` is resized to the field.
    softtwin_answer ask(const softtwin_query &query, std::vector<float> *values = nullptr,
                        std::chrono::milliseconds timeout = std::chrono::seconds(1)) {
        softtwin_answer answer{};
        std::size_t count = 0;
        const auto ms = static_cast<uint32_t>(timeout.count());
        float *data = values ? values->data() : nullptr;
        const std::size_t room = values ? values->size() : 0;
        softtwin_status status = softtwin_client_ask(handle_.get(), &query, ms, &answer, data, room, &count);
        if (status == SOFTTWIN_ARGUMENT && values && count > room) { // asked once to learn the size
            values->resize(count);
            status = softtwin_client_ask(handle_.get(), &query, ms, &answer, values->data(), count, &count);
        }
        check(status);
        if (values) values->resize(count);
        return answer;
    }

private:
    detail::Handle<softtwin_client, softtwin_client_close> handle_;
};

} // namespace softtwin

#endif // SOFTTWIN_HPP
