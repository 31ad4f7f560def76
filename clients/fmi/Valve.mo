// A supply valve and a chamber as a first-order lag, and the twin's FMU, imported by the tool as the model `finger`
// (in OpenModelica: importFMU("finger.fmu")). The tool names the import after the FMU; the ports are its variables.
model Valve "Chamber that fills through a valve, and the twin of the finger behind it"
  parameter Real supply_mpa = 0.09 "Supply pressure, MPa";
  parameter Real time_constant_s = 0.15 "Of valve and chamber, s";
  parameter Real gap_mm = 30 "Gap to the obstacle, mm";
  Real pressure_mpa(start = 0, fixed = true) "Pressure in the chamber, MPa";
  finger twin "The imported FMU";
equation
  time_constant_s * der(pressure_mpa) = (if time < 0.5 then supply_mpa else 0) - pressure_mpa;
  twin.pressure_mpa = pressure_mpa;
  twin.gap_mm = gap_mm;
  when twin.domain_status > 1 then
    Modelica.Utilities.Streams.print("outside the training states at " + String(time) + " s");
  end when;
  annotation(experiment(StopTime = 1, Interval = 0.001));
end Valve;
