// Jogs motor 1 to a position, and waits until it is there: move [POSITION [NAME [SOCKET]]]. C++11.

#include <pmac_dpram.h>

#include <cmath>
#include <cstdlib>
#include <iostream>
#include <memory>
#include <stdexcept>
#include <string>

namespace {

// Calls `function` with an error behind its other arguments, and throws what failed.
template <typename Function, typename... Arguments>
pmac_status call(Function function, Arguments... arguments)
{
    pmac_error error;
    const pmac_status status = function(arguments..., &error);
    if (status != PMAC_OK && status != PMAC_TIMED_OUT)
        throw std::runtime_error(std::string(error.text) + "; " + error.cure);
    return status;
}

using Board = std::unique_ptr<pmac_board, decltype(&pmac_board_close)>;
using Snapshot = std::unique_ptr<pmac_snapshot, decltype(&pmac_snapshot_free)>;

Board open(const char *name, const char *socket)
{
    pmac_board *board;
    call(pmac_board_open, name, socket, &board);
    return Board(board, pmac_board_close);
}

bool is_at(const Board &board, double position)
{
    pmac_snapshot *taken;
    call(pmac_snapshot_take, board.get(), 0u, &taken);
    const Snapshot snapshot(taken, pmac_snapshot_free);
    pmac_motor motor;
    call(pmac_snapshot_motor, snapshot.get(), 1u, &motor, sizeof motor);
    std::int32_t in_position;
    call(pmac_snapshot_motor_flag, snapshot.get(), 1u, "in_position", &in_position);
    std::cout << motor.position << " counts\n";
    return in_position == 1 && std::fabs(motor.position - position) < 1;
}

} // namespace

int main(int count, char **arguments)
{
    try {
        const double position = count > 1 ? std::atof(arguments[1]) : 1000;
        const Board board = open(count > 2 ? arguments[2] : nullptr, count > 3 ? arguments[3] : nullptr);
        call(pmac_jog_to, board.get(), std::uint8_t{1}, position);
        for (int look = 0; look < 100; look++) {
            const std::uint64_t *latest = nullptr;
            for (int update = 0; update < 100; update++)
                call(pmac_board_wait, board.get(), latest, 1000u);
            if (is_at(board, position))
                return 0;
        }
        std::cerr << "move: the motor does not arrive\n";
    } catch (const std::exception &error) {
        std::cerr << "move: " << error.what() << '\n';
    }
    return 1;
}
