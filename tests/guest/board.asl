// A PMAC as a machine's firmware would describe it: window, interrupt, host port, and which interrupt controller lies behind that.
DefinitionBlock ("board.aml", "SSDT", 2, "PMAC", "DPRAM", 1)
{
    Scope (\_SB)
    {
        Device (PMAC)
        {
            Name (_HID, "PMAC0001")
            Name (_CRS, ResourceTemplate ()
            {
                Memory32Fixed (ReadWrite, 0x000D4000, 0x00004000)
                IO (Decode16, 0x0210, 0x0210, 0x01, 0x10)
                Interrupt (ResourceConsumer, Level, ActiveHigh, Exclusive) { 7 }
            })
            Name (_DSD, Package ()
            {
                ToUUID ("daffd814-6eba-4d8c-8a91-bc9bbf4aa301"),
                Package () { Package () { "delta-tau,controller", "pmac" } }
            })
        }
    }
}
