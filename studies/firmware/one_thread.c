/* GRBL 1.1h on a host, in one thread: replaces main.c and util/delay.c of grbl-sim (docs/validation/devices.md has the recipe).

   grbl-sim runs the stepper and serial interrupts in a second thread, which loses real-time bytes on a busy machine.
   Here a signal is the interrupt: it advances the simulated chip by a millisecond, steps, timers and the UART at its
   baud rate, then gives way to the firmware for as long. A busy machine makes the board slow, and nothing else. */
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <unistd.h>

#include "avr/interrupt.h"
#include "avr/io.h"
#include "grbl_interface.h"
#include "simulator.h"

#define BAUD 115200
#define TICKS_PER_BYTE (10 * F_CPU / BAUD)
#define TICK_US 1000

arg_vars_t args;
static volatile sig_atomic_t interrupted = 0;
int avr_main(void);

static void one_byte(void) {
  uint8_t in;
  if (UCSR0B & (1 << UDRIE0)) {
    interrupt_SERIAL_UDRE();
    uint8_t out = UDR0;
    if (write(STDOUT_FILENO, &out, 1) != 1) _exit(1);
  }
  if (read(STDIN_FILENO, &in, 1) == 1) {
    UDR0 = in;
    interrupt_SERIAL_RX();
  }
}

static void one_millisecond(int signal_number) {
  static uint32_t since_byte = 0;
  (void)signal_number;
  interrupted = 1;
  for (uint32_t i = 0; i < F_CPU / 1000; i++) {
    sim.masterclock++;
    timer_interrupts();
    if (++since_byte >= TICKS_PER_BYTE) {
      since_byte = 0;
      one_byte();
    }
  }
  interrupted = 0;
  ualarm(TICK_US, 0);
}

/* The firmware delays inside its stepper interrupt too (st_go_idle): nothing else happens meanwhile. */
void _delay_ms(int ms) {
  if (interrupted) return;
  volatile uint64_t *now = &sim.masterclock;
  for (uint64_t until = *now + (uint64_t)ms * (F_CPU / 1000); *now < until;) pause();
}

void _delay_us(int us) { (void)us; }

int main(void) {
  fcntl(STDIN_FILENO, F_SETFL, fcntl(STDIN_FILENO, F_GETFL) | O_NONBLOCK);
  args.step_out_file = args.block_out_file = args.serial_out_file = fopen("/dev/null", "w");
  sim.speedup = 1;
  grbl_app_init();
  signal(SIGALRM, one_millisecond);
  ualarm(TICK_US, 0);
  return avr_main();
}
