//! The one table of parameters: what each is called, what it can be, and how old it may get.

use crate::sampled::Invalid;
use std::time::Duration;

/// Unit, range and ages of one parameter. Ranges are what the quantity can be in any aircraft this program flies in; a
/// number outside is an error of the sender and is never clamped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParameterSpec {
    /// Snake-case name with the unit as its last word, as in CSV and JSON output.
    pub name: &'static str,
    /// Smallest possible value.
    pub min: f64,
    /// Largest possible value.
    pub max: f64,
    /// The age beyond which it may no longer be shown.
    pub age_max: Duration,
}

macro_rules! parameters {
    ($($(#[$doc:meta])* $variant:ident = $name:literal, $min:expr => $max:expr, $age_ms:expr;)*) => {
        /// Everything that a source can tell this program. The doc of each gives unit, sign and frame.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        #[repr(u8)]
        pub enum Parameter { $($(#[$doc])* $variant,)* }

        impl Parameter {
            /// All of them, in the order of their discriminants.
            pub const ALL: &'static [Self] = &[$(Self::$variant,)*];

            /// How many there are.
            pub const COUNT: usize = Self::ALL.len();

            /// Its row of the table.
            #[must_use]
            pub const fn spec(self) -> ParameterSpec {
                match self {
                    $(Self::$variant => ParameterSpec {
                        name: $name, min: $min, max: $max, age_max: Duration::from_millis($age_ms),
                    },)*
                }
            }
        }
    };
}

const PI: f64 = std::f64::consts::PI;
const HALF_PI: f64 = std::f64::consts::FRAC_PI_2;
const TAU: f64 = std::f64::consts::TAU;

// Ages: attitude, rates and lateral acceleration 0.3 s, air data and heading 2 s, position 1 s for synthetic vision,
// engine 5 s, other navigation and what the pilot has selected 2 to 20 s (start values from FIX-Gateway's table and the update rates that the buses recommend; see limits.rs).
parameters! {
    /// Nose up positive, rad.
    Pitch = "pitch_rad", -HALF_PI => HALF_PI, 300;
    /// Right wing down positive, rad.
    Roll = "roll_rad", -PI => PI, 300;
    /// Clockwise from true north, rad, 0 to 2 pi.
    HeadingTrue = "heading_true_rad", 0.0 => TAU, 2000;
    /// Clockwise from magnetic north, rad, 0 to 2 pi.
    HeadingMagnetic = "heading_magnetic_rad", 0.0 => TAU, 2000;
    /// About the body's forward axis, right wing going down positive, rad/s.
    RollRate = "roll_rate_radps", -10.0 => 10.0, 300;
    /// About the body's right axis, nose going up positive, rad/s.
    PitchRate = "pitch_rate_radps", -10.0 => 10.0, 300;
    /// About the body's down axis, nose going right positive, rad/s.
    YawRate = "yaw_rate_radps", -10.0 => 10.0, 300;
    /// Along the body's forward axis, g.
    LongitudinalAcceleration = "longitudinal_acceleration_g", -20.0 => 20.0, 300;
    /// Along the body's right axis, g: what the accelerometer feels, so the slip ball moves the other way.
    LateralAcceleration = "lateral_acceleration_g", -20.0 => 20.0, 300;
    /// Along the body's up axis, g: 1 in level flight.
    NormalAcceleration = "normal_acceleration_g", -20.0 => 20.0, 300;
    /// Sideslip, wind from the right positive, rad.
    Sideslip = "sideslip_rad", -HALF_PI => HALF_PI, 300;
    /// Angle of attack, rad.
    AngleOfAttack = "angle_of_attack_rad", -PI => PI, 300;
    /// m/s.
    IndicatedAirspeed = "indicated_airspeed_mps", 0.0 => 400.0, 2000;
    /// m/s.
    CalibratedAirspeed = "calibrated_airspeed_mps", 0.0 => 400.0, 2000;
    /// m/s.
    TrueAirspeed = "true_airspeed_mps", 0.0 => 600.0, 2000;
    /// Above the 1013.25 hPa surface of the ICAO standard atmosphere, m.
    PressureAltitude = "pressure_altitude_m", -1000.0 => 25_000.0, 2000;
    /// Corrected by the source with its own setting ([`Parameter::BaroSetting`]), m.
    BaroAltitude = "baro_altitude_m", -1000.0 => 25_000.0, 2000;
    /// The setting that the source used for [`Parameter::BaroAltitude`], hPa.
    BaroSetting = "baro_setting_hpa", 800.0 => 1100.0, 20_000;
    /// Up positive, m/s.
    VerticalSpeed = "vertical_speed_mps", -150.0 => 150.0, 2000;
    /// Static (outside) air temperature, K.
    StaticAirTemperature = "static_air_temperature_k", 173.0 => 343.0, 5000;
    /// Geodetic on WGS 84, north positive, rad.
    Latitude = "latitude_rad", -HALF_PI => HALF_PI, 1000;
    /// On WGS 84, east positive, rad, -pi to pi.
    Longitude = "longitude_rad", -PI => PI, 1000;
    /// Above mean sea level (the EGM96 geoid), m, geometric.
    AltitudeMsl = "altitude_msl_m", -1000.0 => 30_000.0, 1000;
    /// Above the WGS 84 ellipsoid, m, geometric.
    HeightEllipsoid = "height_ellipsoid_m", -1200.0 => 30_000.0, 1000;
    /// Over the ground, m/s.
    GroundSpeed = "ground_speed_mps", 0.0 => 700.0, 2000;
    /// Direction of motion over the ground, clockwise from true north, rad, 0 to 2 pi.
    Track = "track_rad", 0.0 => TAU, 2000;
    /// How fast the heading changes, right (clockwise) positive, rad/s.
    TurnRate = "turn_rate_radps", -10.0 => 10.0, 300;
    /// Deflection of the slip ball from the body's down axis, to the right positive, rad.
    SlipBall = "slip_ball_rad", -HALF_PI => HALF_PI, 300;
    /// How much of the angle of attack at the stall is used, percent: the source's own scale.
    AngleOfAttackUsed = "angle_of_attack_used_percent", 0.0 => 100.0, 300;
    /// Compensated for total energy, up positive, m/s: what a glider's variometer shows.
    TotalEnergyVerticalSpeed = "total_energy_vertical_speed_mps", -150.0 => 150.0, 2000;
    /// True airspeed over the speed of sound.
    MachNumber = "mach_number_ratio", 0.0 => 3.0, 2000;
    /// Static pressure, hPa.
    StaticPressure = "static_pressure_hpa", 10.0 => 1100.0, 2000;
    /// Total (pitot) pressure, hPa.
    TotalPressure = "total_pressure_hpa", 10.0 => 3000.0, 2000;
    /// Total (stagnation) air temperature, K.
    TotalAirTemperature = "total_air_temperature_k", 173.0 => 473.0, 5000;
    /// The altitude of the ICAO standard atmosphere that has the air's density, m.
    DensityAltitude = "density_altitude_m", -5000.0 => 30_000.0, 5000;
    /// m/s.
    WindSpeed = "wind_speed_mps", 0.0 => 200.0, 5000;
    /// Where the wind comes from, clockwise from true north, rad, 0 to 2 pi.
    WindDirectionTrue = "wind_direction_true_rad", 0.0 => TAU, 5000;
    /// Where the wind comes from, clockwise from magnetic north, rad, 0 to 2 pi.
    WindDirectionMagnetic = "wind_direction_magnetic_rad", 0.0 => TAU, 5000;
    /// Direction of motion over the ground, clockwise from magnetic north, rad, 0 to 2 pi.
    TrackMagnetic = "track_magnetic_rad", 0.0 => TAU, 2000;
    /// Magnetic north as seen from true north, east positive, rad.
    MagneticVariation = "magnetic_variation_rad", -PI => PI, 20_000;
    /// Above the ground below, m.
    HeightAgl = "height_agl_m", -100.0 => 30_000.0, 2000;
    /// What a receiver's position is made from: 0 nothing, 2 horizontal only, 3 with height.
    FixDimensions = "fix_dimensions", 0.0 => 3.0, 2000;
    /// Satellites that the position is made from.
    SatellitesUsed = "satellites_used_count", 0.0 => 255.0, 5000;
    /// Estimated error of the horizontal position as its source states it (GDL90: 95 %; u-blox: one standard deviation), m.
    HorizontalAccuracy = "horizontal_accuracy_m", 0.0 => 100_000.0, 5000;
    /// Estimated error of the geometric height as its source states it (GDL90: 95 %; u-blox: one standard deviation), m.
    VerticalAccuracy = "vertical_accuracy_m", 0.0 => 100_000.0, 5000;
    /// Horizontal dilution of precision.
    HorizontalDilution = "horizontal_dilution_ratio", 0.0 => 100.0, 5000;
    /// Coordinated universal time since midnight, s; a leap second makes it 86 400 and a fraction. No clock: see `time`.
    UtcTimeOfDay = "utc_time_of_day_s", 0.0 => 86_401.0, 2000;
    /// Days since 1 January 1970, coordinated universal time.
    UtcDate = "utc_date_days", 10_957.0 => 73_050.0, 20_000;
    /// The pilot's heading bug, clockwise from magnetic north, rad, 0 to 2 pi.
    SelectedHeading = "selected_heading_magnetic_rad", 0.0 => TAU, 5000;
    /// The pilot's course, clockwise from magnetic north, rad, 0 to 2 pi.
    SelectedCourse = "selected_course_magnetic_rad", 0.0 => TAU, 5000;
    /// The pilot's altitude bug, baro-corrected, m.
    SelectedAltitude = "selected_altitude_m", -1000.0 => 25_000.0, 5000;
    /// The pilot's airspeed bug, indicated, m/s.
    SelectedAirspeed = "selected_airspeed_mps", 0.0 => 400.0, 5000;
    /// The pilot's vertical speed bug, up positive, m/s.
    SelectedVerticalSpeed = "selected_vertical_speed_mps", -150.0 => 150.0, 5000;
    /// Distance from the desired track as the source signs it, m.
    CrossTrack = "cross_track_m", -1e6 => 1e6, 2000;
    /// Deflection of the course needle in full scales, to the right positive.
    CourseDeflection = "course_deflection_ratio", -1.0 => 1.0, 2000;
    /// Deflection of the glide path needle in full scales, up positive.
    GlidePathDeflection = "glide_path_deflection_ratio", -1.0 => 1.0, 2000;
    /// Angle from the glide path as the source signs it, rad.
    GlidePathDeviation = "glide_path_deviation_rad", -HALF_PI => HALF_PI, 2000;
    /// Control surface: flaps, down positive, rad.
    FlapAngle = "flap_angle_rad", -HALF_PI => HALF_PI, 5000;
    /// First engine, 1/min.
    EngineSpeed = "engine_speed_rpm", 0.0 => 60_000.0, 5000;
    /// Second engine, 1/min.
    SecondEngineSpeed = "second_engine_speed_rpm", 0.0 => 60_000.0, 5000;
    /// First engine: propeller, rotor or second spool, 1/min.
    PropellerSpeed = "propeller_speed_rpm", 0.0 => 60_000.0, 5000;
    /// Second engine: propeller, rotor or second spool, 1/min.
    SecondPropellerSpeed = "second_propeller_speed_rpm", 0.0 => 60_000.0, 5000;
    /// First engine: manifold pressure, absolute, hPa.
    ManifoldPressure = "manifold_pressure_hpa", 0.0 => 3500.0, 5000;
    /// Second engine: manifold pressure, absolute, hPa.
    SecondManifoldPressure = "second_manifold_pressure_hpa", 0.0 => 3500.0, 5000;
    /// First engine: fuel flow, l/h.
    FuelFlow = "fuel_flow_lph", 0.0 => 2000.0, 5000;
    /// Second engine: fuel flow, l/h.
    SecondFuelFlow = "second_fuel_flow_lph", 0.0 => 2000.0, 5000;
    /// First engine: fuel pressure, hPa above ambient.
    FuelPressure = "fuel_pressure_hpa", 0.0 => 25_000.0, 5000;
    /// Second engine: fuel pressure, hPa above ambient.
    SecondFuelPressure = "second_fuel_pressure_hpa", 0.0 => 25_000.0, 5000;
    /// First engine: oil pressure, hPa above ambient.
    OilPressure = "oil_pressure_hpa", 0.0 => 25_000.0, 5000;
    /// Second engine: oil pressure, hPa above ambient.
    SecondOilPressure = "second_oil_pressure_hpa", 0.0 => 25_000.0, 5000;
    /// First engine: oil temperature, K.
    OilTemperature = "oil_temperature_k", 200.0 => 500.0, 5000;
    /// Second engine: oil temperature, K.
    SecondOilTemperature = "second_oil_temperature_k", 200.0 => 500.0, 5000;
    /// First engine: coolant temperature, K.
    CoolantTemperature = "coolant_temperature_k", 200.0 => 500.0, 5000;
    /// Second engine: coolant temperature, K.
    SecondCoolantTemperature = "second_coolant_temperature_k", 200.0 => 500.0, 5000;
    /// First engine: carburettor temperature, K.
    CarburettorTemperature = "carburettor_temperature_k", 200.0 => 500.0, 5000;
    /// Second engine: carburettor temperature, K.
    SecondCarburettorTemperature = "second_carburettor_temperature_k", 200.0 => 500.0, 5000;
    /// First engine: turbine inlet temperature, K.
    TurbineInletTemperature = "turbine_inlet_temperature_k", 200.0 => 1800.0, 5000;
    /// Second engine: turbine inlet temperature, K.
    SecondTurbineInletTemperature = "second_turbine_inlet_temperature_k", 200.0 => 1800.0, 5000;
    /// First engine: time run, h.
    EngineTime = "engine_time_h", 0.0 => 100_000.0, 5000;
    /// Second engine: time run, h.
    SecondEngineTime = "second_engine_time_h", 0.0 => 100_000.0, 5000;
    /// First engine: power, percent of rated power.
    EnginePower = "engine_power_percent", 0.0 => 200.0, 5000;
    /// Second engine: power, percent of rated power.
    SecondEnginePower = "second_engine_power_percent", 0.0 => 200.0, 5000;
    /// First engine, cylinder 1: cylinder head temperature, K.
    CylinderHeadTemperature1 = "cylinder_head_temperature_1_k", 200.0 => 700.0, 5000;
    /// First engine, cylinder 2: cylinder head temperature, K.
    CylinderHeadTemperature2 = "cylinder_head_temperature_2_k", 200.0 => 700.0, 5000;
    /// First engine, cylinder 3: cylinder head temperature, K.
    CylinderHeadTemperature3 = "cylinder_head_temperature_3_k", 200.0 => 700.0, 5000;
    /// First engine, cylinder 4: cylinder head temperature, K.
    CylinderHeadTemperature4 = "cylinder_head_temperature_4_k", 200.0 => 700.0, 5000;
    /// First engine, cylinder 5: cylinder head temperature, K.
    CylinderHeadTemperature5 = "cylinder_head_temperature_5_k", 200.0 => 700.0, 5000;
    /// First engine, cylinder 6: cylinder head temperature, K.
    CylinderHeadTemperature6 = "cylinder_head_temperature_6_k", 200.0 => 700.0, 5000;
    /// Second engine, cylinder 1: cylinder head temperature, K.
    SecondCylinderHeadTemperature1 = "second_cylinder_head_temperature_1_k", 200.0 => 700.0, 5000;
    /// Second engine, cylinder 2: cylinder head temperature, K.
    SecondCylinderHeadTemperature2 = "second_cylinder_head_temperature_2_k", 200.0 => 700.0, 5000;
    /// Second engine, cylinder 3: cylinder head temperature, K.
    SecondCylinderHeadTemperature3 = "second_cylinder_head_temperature_3_k", 200.0 => 700.0, 5000;
    /// Second engine, cylinder 4: cylinder head temperature, K.
    SecondCylinderHeadTemperature4 = "second_cylinder_head_temperature_4_k", 200.0 => 700.0, 5000;
    /// Second engine, cylinder 5: cylinder head temperature, K.
    SecondCylinderHeadTemperature5 = "second_cylinder_head_temperature_5_k", 200.0 => 700.0, 5000;
    /// Second engine, cylinder 6: cylinder head temperature, K.
    SecondCylinderHeadTemperature6 = "second_cylinder_head_temperature_6_k", 200.0 => 700.0, 5000;
    /// First engine, cylinder 1: exhaust gas temperature, K.
    ExhaustGasTemperature1 = "exhaust_gas_temperature_1_k", 200.0 => 1500.0, 5000;
    /// First engine, cylinder 2: exhaust gas temperature, K.
    ExhaustGasTemperature2 = "exhaust_gas_temperature_2_k", 200.0 => 1500.0, 5000;
    /// First engine, cylinder 3: exhaust gas temperature, K.
    ExhaustGasTemperature3 = "exhaust_gas_temperature_3_k", 200.0 => 1500.0, 5000;
    /// First engine, cylinder 4: exhaust gas temperature, K.
    ExhaustGasTemperature4 = "exhaust_gas_temperature_4_k", 200.0 => 1500.0, 5000;
    /// First engine, cylinder 5: exhaust gas temperature, K.
    ExhaustGasTemperature5 = "exhaust_gas_temperature_5_k", 200.0 => 1500.0, 5000;
    /// First engine, cylinder 6: exhaust gas temperature, K.
    ExhaustGasTemperature6 = "exhaust_gas_temperature_6_k", 200.0 => 1500.0, 5000;
    /// Second engine, cylinder 1: exhaust gas temperature, K.
    SecondExhaustGasTemperature1 = "second_exhaust_gas_temperature_1_k", 200.0 => 1500.0, 5000;
    /// Second engine, cylinder 2: exhaust gas temperature, K.
    SecondExhaustGasTemperature2 = "second_exhaust_gas_temperature_2_k", 200.0 => 1500.0, 5000;
    /// Second engine, cylinder 3: exhaust gas temperature, K.
    SecondExhaustGasTemperature3 = "second_exhaust_gas_temperature_3_k", 200.0 => 1500.0, 5000;
    /// Second engine, cylinder 4: exhaust gas temperature, K.
    SecondExhaustGasTemperature4 = "second_exhaust_gas_temperature_4_k", 200.0 => 1500.0, 5000;
    /// Second engine, cylinder 5: exhaust gas temperature, K.
    SecondExhaustGasTemperature5 = "second_exhaust_gas_temperature_5_k", 200.0 => 1500.0, 5000;
    /// Second engine, cylinder 6: exhaust gas temperature, K.
    SecondExhaustGasTemperature6 = "second_exhaust_gas_temperature_6_k", 200.0 => 1500.0, 5000;
    /// Fuel in tank 1 (1 left, 2 right, then others), l.
    FuelQuantity1 = "fuel_quantity_1_l", 0.0 => 5000.0, 5000;
    /// Fuel in tank 2 (1 left, 2 right, then others), l.
    FuelQuantity2 = "fuel_quantity_2_l", 0.0 => 5000.0, 5000;
    /// Fuel in tank 3 (1 left, 2 right, then others), l.
    FuelQuantity3 = "fuel_quantity_3_l", 0.0 => 5000.0, 5000;
    /// Fuel in tank 4 (1 left, 2 right, then others), l.
    FuelQuantity4 = "fuel_quantity_4_l", 0.0 => 5000.0, 5000;
    /// First electrical bus, V.
    BusVoltage1 = "bus_voltage_1_v", -5.0 => 1000.0, 5000;
    /// First electrical bus or battery: current drawn, A.
    BusCurrent1 = "bus_current_1_a", -1000.0 => 1000.0, 5000;
    /// Second electrical bus, V.
    BusVoltage2 = "bus_voltage_2_v", -5.0 => 1000.0, 5000;
    /// Second electrical bus or battery: current drawn, A.
    BusCurrent2 = "bus_current_2_a", -1000.0 => 1000.0, 5000;
    /// Third electrical bus, V.
    BusVoltage3 = "bus_voltage_3_v", -5.0 => 1000.0, 5000;
    /// Third electrical bus: current drawn, A.
    BusCurrent3 = "bus_current_3_a", -1000.0 => 1000.0, 5000;
    /// Fourth electrical bus, V.
    BusVoltage4 = "bus_voltage_4_v", -5.0 => 1000.0, 5000;
    /// Fourth electrical bus: current drawn, A.
    BusCurrent4 = "bus_current_4_a", -1000.0 => 1000.0, 5000;
    /// First generator or alternator, V.
    GeneratorVoltage1 = "generator_voltage_1_v", -5.0 => 1000.0, 5000;
    /// First generator or alternator: current delivered, A.
    GeneratorCurrent1 = "generator_current_1_a", -1000.0 => 1000.0, 5000;
    /// Second generator or alternator, V.
    GeneratorVoltage2 = "generator_voltage_2_v", -5.0 => 1000.0, 5000;
    /// Second generator or alternator: current delivered, A.
    GeneratorCurrent2 = "generator_current_2_a", -1000.0 => 1000.0, 5000;
    /// Third generator or alternator, V.
    GeneratorVoltage3 = "generator_voltage_3_v", -5.0 => 1000.0, 5000;
    /// Third generator or alternator: current delivered, A.
    GeneratorCurrent3 = "generator_current_3_a", -1000.0 => 1000.0, 5000;
    /// Fourth generator or alternator, V.
    GeneratorVoltage4 = "generator_voltage_4_v", -5.0 => 1000.0, 5000;
    /// Fourth generator or alternator: current delivered, A.
    GeneratorCurrent4 = "generator_current_4_a", -1000.0 => 1000.0, 5000;
    /// First engine: temperature between turbines, K.
    InterTurbineTemperature = "inter_turbine_temperature_k", 200.0 => 1800.0, 5000;
    /// Second engine: temperature between turbines, K.
    SecondInterTurbineTemperature = "second_inter_turbine_temperature_k", 200.0 => 1800.0, 5000;
    /// First engine: turbine outlet temperature, K.
    TurbineOutletTemperature = "turbine_outlet_temperature_k", 200.0 => 1800.0, 5000;
    /// Second engine: turbine outlet temperature, K.
    SecondTurbineOutletTemperature = "second_turbine_outlet_temperature_k", 200.0 => 1800.0, 5000;
    /// First engine: oil, l.
    OilQuantity = "oil_quantity_l", 0.0 => 500.0, 5000;
    /// Second engine: oil, l.
    SecondOilQuantity = "second_oil_quantity_l", 0.0 => 500.0, 5000;
    /// First engine: coolant, l.
    CoolantQuantity = "coolant_quantity_l", 0.0 => 500.0, 5000;
    /// Second engine: coolant, l.
    SecondCoolantQuantity = "second_coolant_quantity_l", 0.0 => 500.0, 5000;
    /// First engine: pressure behind the fuel pump, hPa above ambient.
    FuelPumpPressure = "fuel_pump_pressure_hpa", 0.0 => 25_000.0, 5000;
    /// Second engine: pressure behind the fuel pump, hPa above ambient.
    SecondFuelPumpPressure = "second_fuel_pump_pressure_hpa", 0.0 => 25_000.0, 5000;
    /// First engine: pressure behind the compressor, absolute, hPa.
    UpperDeckPressure = "upper_deck_pressure_hpa", 0.0 => 3500.0, 5000;
    /// Second engine: pressure behind the compressor, absolute, hPa.
    SecondUpperDeckPressure = "second_upper_deck_pressure_hpa", 0.0 => 3500.0, 5000;
    /// First engine: time run by its tachometer, h.
    TachometerTime = "tachometer_time_h", 0.0 => 100_000.0, 5000;
    /// Second engine: time run by its tachometer, h.
    SecondTachometerTime = "second_tachometer_time_h", 0.0 => 100_000.0, 5000;
    /// First engine: electric motor, A.
    MotorCurrent = "motor_current_a", 0.0 => 66_000.0, 5000;
    /// Second engine: electric motor, A.
    SecondMotorCurrent = "second_motor_current_a", 0.0 => 66_000.0, 5000;
    /// First engine: main propulsion bus, V.
    PropulsionVoltage = "propulsion_voltage_v", 0.0 => 7000.0, 5000;
    /// Second engine: main propulsion bus, V.
    SecondPropulsionVoltage = "second_propulsion_voltage_v", 0.0 => 7000.0, 5000;
    /// First main battery: current, A, as the source signs it.
    BatteryCurrent1 = "battery_current_1_a", -33_000.0 => 33_000.0, 5000;
    /// First main battery: temperature, K.
    BatteryTemperature1 = "battery_temperature_1_k", 200.0 => 500.0, 5000;
    /// First main battery: charge, percent.
    BatteryCharge1 = "battery_charge_1_percent", 0.0 => 100.0, 5000;
    /// Second main battery: current, A, as the source signs it.
    BatteryCurrent2 = "battery_current_2_a", -33_000.0 => 33_000.0, 5000;
    /// Second main battery: temperature, K.
    BatteryTemperature2 = "battery_temperature_2_k", 200.0 => 500.0, 5000;
    /// Second main battery: charge, percent.
    BatteryCharge2 = "battery_charge_2_percent", 0.0 => 100.0, 5000;
    /// Total less static pressure, hPa.
    DifferentialPressure = "differential_pressure_hpa", 0.0 => 3000.0, 2000;
    /// Fuel left in all tanks by the source's own reckoning, l.
    FuelRemaining = "fuel_remaining_l", 0.0 => 10_000.0, 5000;
    /// First tank: fuel as mass, kg, of senders that measure it so.
    FuelMass1 = "fuel_mass_1_kg", 0.0 => 10_000.0, 5000;
    /// Second tank: fuel as mass, kg.
    FuelMass2 = "fuel_mass_2_kg", 0.0 => 10_000.0, 5000;
    /// Third tank: fuel as mass, kg.
    FuelMass3 = "fuel_mass_3_kg", 0.0 => 10_000.0, 5000;
    /// Fourth tank: fuel as mass, kg.
    FuelMass4 = "fuel_mass_4_kg", 0.0 => 10_000.0, 5000;
    /// Angle from the localizer's course as the source signs it, rad.
    LocalizerDeviation = "localizer_deviation_rad", -HALF_PI => HALF_PI, 2000;
    /// The pilot's glide path, above the horizon, rad.
    SelectedGlidePath = "selected_glide_path_rad", 0.0 => HALF_PI, 5000;
    /// The next waypoint: geodetic on WGS 84, north positive, rad.
    WaypointLatitude = "waypoint_latitude_rad", -HALF_PI => HALF_PI, 5000;
    /// The next waypoint: on WGS 84, east positive, rad.
    WaypointLongitude = "waypoint_longitude_rad", -PI => PI, 5000;
    /// The next waypoint: altitude, m.
    WaypointAltitude = "waypoint_altitude_m", -1000.0 => 30_000.0, 5000;
    /// The next waypoint: distance to it, m.
    WaypointDistance = "waypoint_distance_m", 0.0 => 2.1e7, 5000;
    /// The next waypoint: time to it, s.
    WaypointTimeToGo = "waypoint_time_to_go_s", 0.0 => 400_000.0, 5000;
    /// Brightness that the panel is set to, percent.
    PanelDimmer = "panel_dimmer_percent", 0.0 => 100.0, 20_000;
}

impl Parameter {
    /// Its row in arrays indexed by parameter.
    #[must_use]
    pub const fn index(self) -> usize {
        self as usize
    }

    /// A number fresh off the wire, in this parameter's unit, as a verdict: finite and within range, or out of range.
    ///
    /// # Errors
    /// [`Invalid::OutOfRange`] for NaN, infinities and anything outside the table's range.
    pub fn check(self, value: f64) -> Result<f64, Invalid> {
        let spec = self.spec();
        if value >= spec.min && value <= spec.max {
            Ok(value)
        } else {
            Err(Invalid::OutOfRange)
        }
    }
}

/// Parameters of several engines, by engine: the first, the second.
pub mod engines {
    use super::Parameter::{self, *};

    /// 1/min.
    pub const SPEED: [Parameter; 2] = [EngineSpeed, SecondEngineSpeed];
    /// 1/min.
    pub const PROPELLER_SPEED: [Parameter; 2] = [PropellerSpeed, SecondPropellerSpeed];
    /// hPa.
    pub const MANIFOLD_PRESSURE: [Parameter; 2] = [ManifoldPressure, SecondManifoldPressure];
    /// l/h.
    pub const FUEL_FLOW: [Parameter; 2] = [FuelFlow, SecondFuelFlow];
    /// hPa.
    pub const FUEL_PRESSURE: [Parameter; 2] = [FuelPressure, SecondFuelPressure];
    /// hPa.
    pub const OIL_PRESSURE: [Parameter; 2] = [OilPressure, SecondOilPressure];
    /// K.
    pub const OIL_TEMPERATURE: [Parameter; 2] = [OilTemperature, SecondOilTemperature];
    /// K.
    pub const COOLANT_TEMPERATURE: [Parameter; 2] = [CoolantTemperature, SecondCoolantTemperature];
    /// K.
    pub const CARBURETTOR_TEMPERATURE: [Parameter; 2] =
        [CarburettorTemperature, SecondCarburettorTemperature];
    /// K.
    pub const TURBINE_INLET_TEMPERATURE: [Parameter; 2] =
        [TurbineInletTemperature, SecondTurbineInletTemperature];
    /// h.
    pub const TIME: [Parameter; 2] = [EngineTime, SecondEngineTime];
    /// percent.
    pub const POWER: [Parameter; 2] = [EnginePower, SecondEnginePower];
    /// K.
    pub const INTER_TURBINE_TEMPERATURE: [Parameter; 2] =
        [InterTurbineTemperature, SecondInterTurbineTemperature];
    /// K.
    pub const TURBINE_OUTLET_TEMPERATURE: [Parameter; 2] =
        [TurbineOutletTemperature, SecondTurbineOutletTemperature];
    /// l.
    pub const OIL_QUANTITY: [Parameter; 2] = [OilQuantity, SecondOilQuantity];
    /// l.
    pub const COOLANT_QUANTITY: [Parameter; 2] = [CoolantQuantity, SecondCoolantQuantity];
    /// hPa.
    pub const FUEL_PUMP_PRESSURE: [Parameter; 2] = [FuelPumpPressure, SecondFuelPumpPressure];
    /// hPa.
    pub const UPPER_DECK_PRESSURE: [Parameter; 2] = [UpperDeckPressure, SecondUpperDeckPressure];
    /// h.
    pub const TACHOMETER_TIME: [Parameter; 2] = [TachometerTime, SecondTachometerTime];
    /// A.
    pub const MOTOR_CURRENT: [Parameter; 2] = [MotorCurrent, SecondMotorCurrent];
    /// V.
    pub const PROPULSION_VOLTAGE: [Parameter; 2] = [PropulsionVoltage, SecondPropulsionVoltage];
    /// K, by engine and cylinder.
    pub const CYLINDER_HEAD_TEMPERATURE: [[Parameter; 6]; 2] = [
        [
            CylinderHeadTemperature1,
            CylinderHeadTemperature2,
            CylinderHeadTemperature3,
            CylinderHeadTemperature4,
            CylinderHeadTemperature5,
            CylinderHeadTemperature6,
        ],
        [
            SecondCylinderHeadTemperature1,
            SecondCylinderHeadTemperature2,
            SecondCylinderHeadTemperature3,
            SecondCylinderHeadTemperature4,
            SecondCylinderHeadTemperature5,
            SecondCylinderHeadTemperature6,
        ],
    ];
    /// K, by engine and cylinder.
    pub const EXHAUST_GAS_TEMPERATURE: [[Parameter; 6]; 2] = [
        [
            ExhaustGasTemperature1,
            ExhaustGasTemperature2,
            ExhaustGasTemperature3,
            ExhaustGasTemperature4,
            ExhaustGasTemperature5,
            ExhaustGasTemperature6,
        ],
        [
            SecondExhaustGasTemperature1,
            SecondExhaustGasTemperature2,
            SecondExhaustGasTemperature3,
            SecondExhaustGasTemperature4,
            SecondExhaustGasTemperature5,
            SecondExhaustGasTemperature6,
        ],
    ];
}

/// Fuel quantities by tank, l: left, right, then others.
pub const FUEL_QUANTITY: [Parameter; 4] = [
    Parameter::FuelQuantity1,
    Parameter::FuelQuantity2,
    Parameter::FuelQuantity3,
    Parameter::FuelQuantity4,
];
/// Fuel by tank, kg.
pub const FUEL_MASS: [Parameter; 4] = [
    Parameter::FuelMass1,
    Parameter::FuelMass2,
    Parameter::FuelMass3,
    Parameter::FuelMass4,
];
/// Voltages by electrical bus.
pub const BUS_VOLTAGE: [Parameter; 4] = [
    Parameter::BusVoltage1,
    Parameter::BusVoltage2,
    Parameter::BusVoltage3,
    Parameter::BusVoltage4,
];
/// Currents by electrical bus.
pub const BUS_CURRENT: [Parameter; 4] = [
    Parameter::BusCurrent1,
    Parameter::BusCurrent2,
    Parameter::BusCurrent3,
    Parameter::BusCurrent4,
];
/// Voltages by generator.
pub const GENERATOR_VOLTAGE: [Parameter; 4] = [
    Parameter::GeneratorVoltage1,
    Parameter::GeneratorVoltage2,
    Parameter::GeneratorVoltage3,
    Parameter::GeneratorVoltage4,
];
/// Currents by generator.
pub const GENERATOR_CURRENT: [Parameter; 4] = [
    Parameter::GeneratorCurrent1,
    Parameter::GeneratorCurrent2,
    Parameter::GeneratorCurrent3,
    Parameter::GeneratorCurrent4,
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indices_follow_the_list() {
        for (i, p) in Parameter::ALL.iter().enumerate() {
            assert_eq!(p.index(), i, "{p:?}");
        }
    }

    #[test]
    fn no_range_accepts_what_is_not_a_number() {
        for p in Parameter::ALL {
            for x in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300] {
                assert_eq!(p.check(x), Err(Invalid::OutOfRange), "{p:?} {x}");
            }
        }
    }

    #[test]
    fn names_are_unique() {
        let mut names: Vec<_> = Parameter::ALL.iter().map(|p| p.spec().name).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), Parameter::COUNT);
    }
}
